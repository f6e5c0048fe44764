//! Linear systems of Newton's method: conjugate gradients in double precision, preconditioned by a Cholesky factor in single
//! precision, which is kept while it serves. Measured on 81 135 unknowns, a single factor takes half the memory, 0.6 of the
//! time to make and 0.4 of the time to apply; with a fresh one, one or two iterations solve the system.

use super::assembly::Pattern;
use super::contact::RankOne;
use super::error::SolveError;
use super::factor::{Factor, Indefinite, Symbolic};
use super::low_rank::LowRank;
use crate::control::Clock;
use crate::geometry::Vector;
use nalgebra::Matrix3;
use std::sync::Arc;

/// Iterations with an older factor after which a new one is cheaper: a factorisation costs about as much as 15 solves.
const MAX_WITH_OLD: usize = 12;
/// Iterations with a new factor after which single precision is held to be too coarse for the matrix.
const MAX_WITH_NEW: usize = 25;
/// Iterations of relaxation before it is given up.
const MAX_RELAXATIONS: usize = 20_000;
/// Tolerance of relaxation.
const RELAXED: f64 = 1e-9;

/// Guesses of the set of touching points.
const MAX_GUESSES: usize = 8;

/// A matrix and what it consists of.
#[derive(Debug, Clone, Copy)]
pub(super) struct System<'a> {
    pub(super) values: &'a [f64],
    /// Without contact.
    pub(super) elastic: &'a [f64],
    /// The terms of contact, or what is most of them.
    pub(super) contact: &'a [RankOne],
}

/// How a system was solved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Work {
    pub(super) factorised: bool,
    pub(super) cg_iterations: usize,
}

/// Preconditioned conjugate gradients with their factor.
#[derive(Debug)]
pub(super) struct LinearSolver {
    preconditioner: Preconditioner,
    /// Contact that the factor does not know of.
    low_rank: Option<LowRank>,
    /// The factor knows of contact, because elements alone are not stable.
    whole: bool,
    factorisations: usize,
    clock: Clock,
    /// Time of factorisations and of solves, s.
    times: (f64, f64),
    /// The factor does not belong to a matrix like the next one.
    stale: bool,
}

/// What conjugate gradients are preconditioned by.
#[derive(Debug)]
enum Preconditioner {
    /// A Cholesky factor of the whole matrix.
    Factor {
        symbolic: Arc<Symbolic>,
        single: Box<Factor<f32>>,
        /// Made when a matrix defeats the single one; used from then on.
        double: Option<Box<Factor<f64>>>,
    },
    /// Inverse 3x3 tensors of the vertices: only forces of neighbours act on a vertex in one iteration.
    Vertices(Vec<Matrix3<f64>>),
}

impl std::fmt::Debug for Symbolic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Symbolic")
    }
}

/// Where conjugate gradients stand.
struct Iterate {
    /// Residual b - A x.
    r: Vec<f64>,
    /// What `r·z` was for x = 0, with the first preconditioner that saw it.
    start: Option<f64>,
    iterations: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Solved,
    Slow,
    Indefinite,
}

impl LinearSolver {
    /// Symbolic analysis and room for the factor. Contact acts on nodes from `first_last` on.
    pub(super) fn new(pattern: &Pattern, first_last: usize, clock: Clock) -> Result<Self, SolveError> {
        let symbolic = Arc::new(Symbolic::new(pattern, first_last)?);
        let single = Box::new(Factor::new(Arc::clone(&symbolic))?);
        let preconditioner = Preconditioner::Factor { symbolic, single, double: None };
        Ok(Self::with(preconditioner, clock))
    }

    /// Relaxation of vertices under the forces of their neighbours, without any factor.
    pub(super) fn relaxation(clock: Clock) -> Self {
        Self::with(Preconditioner::Vertices(Vec::new()), clock)
    }

    fn with(preconditioner: Preconditioner, clock: Clock) -> Self {
        Self { preconditioner, low_rank: None, whole: false, factorisations: 0, clock, times: (0.0, 0.0), stale: false }
    }

    /// Starts the times anew.
    pub(super) fn forget_times(&mut self) {
        self.times = (0.0, 0.0);
    }

    /// Time of factorisations and of solves so far, s.
    pub(super) fn times(&self) -> (f64, f64) {
        self.times
    }

    fn relaxes(&self) -> bool {
        matches!(self.preconditioner, Preconditioner::Vertices(_))
    }

    /// The tolerance to solve with where `wanted` would do for a factor: vertices alone say little about the error that is left.
    pub(super) fn tolerance(&self, wanted: f64) -> f64 {
        if self.relaxes() { wanted.min(RELAXED) } else { wanted }
    }

    pub(super) fn factorisations(&self) -> usize {
        self.factorisations
    }

    pub(super) fn has_factor(&self) -> bool {
        match &self.preconditioner {
            Preconditioner::Factor { single, double, .. } => {
                double.as_ref().map_or(single.is_valid(), |double| double.is_valid())
            }
            Preconditioner::Vertices(inverses) => !inverses.is_empty(),
        }
    }

    /// Applies the last factor, which may belong to an older matrix.
    pub(super) fn precondition(&mut self, x: &mut [f64]) {
        let low_rank = self.low_rank.as_ref();
        let between = |corner: &mut [f64]| {
            if let Some(low_rank) = low_rank {
                low_rank.apply(corner);
            }
        };
        match &self.preconditioner {
            Preconditioner::Factor { double: Some(factor), .. } => factor.solve(x, between),
            Preconditioner::Factor { single, .. } => single.solve(x, between),
            Preconditioner::Vertices(inverses) => {
                for (x, inverse) in x.as_chunks_mut::<3>().0.iter_mut().zip(inverses) {
                    *x = (*inverse * Vector::from(*x)).into();
                }
            }
        }
    }

    /// Has the next system factorised at once.
    pub(super) fn refresh(&mut self) {
        self.stale = true;
    }

    /// Makes a factor of the elements' matrix when there is none that serves.
    pub(super) fn prepare(&mut self, pattern: &Pattern, elastic: &[f64]) {
        if !self.relaxes() && (self.stale || !self.has_factor()) {
            let begin = (self.clock)();
            self.low_rank = None;
            // A failure shows again when the system is solved.
            self.stale = self.factorise(pattern, elastic, elastic, false, false).is_err();
            self.times.0 += (self.clock)() - begin;
        }
    }

    /// Tells the factor of contact.
    fn correct(&mut self, contact: &[RankOne]) {
        let known = self.low_rank.take();
        self.low_rank = match &mut self.preconditioner {
            Preconditioner::Factor { .. } if self.whole => None,
            Preconditioner::Factor { double: Some(factor), .. } if factor.is_valid() => {
                LowRank::new(contact, known, factor.corner(), |v| factor.corner_solve(v))
            }
            Preconditioner::Factor { double: None, single: factor, .. } if factor.is_valid() => {
                LowRank::new(contact, known, factor.corner(), |v| factor.corner_solve(v))
            }
            Preconditioner::Factor { .. } | Preconditioner::Vertices(_) => None,
        };
    }

    /// Which of the terms `contact` push, as far as the present factor can tell: a guess that costs a fraction of a solve.
    ///
    /// - `gradient`: of the elements' energy
    /// - `pushes(d, i)`: load on the vector of term `i`, for unknowns `d` whose entries above the corner are missing, and whether it pushes
    /// - `active`: terms to begin with, ascending
    pub(super) fn guess_active(
        &mut self,
        gradient: &[f64],
        contact: &[RankOne],
        loads: &[f64],
        pushes: &dyn Fn(&[f64], usize) -> bool,
        active: Vec<usize>,
    ) -> Vec<usize> {
        if self.whole || self.stale || !self.has_factor() || self.relaxes() || contact.is_empty() {
            return active;
        }
        let begin = (self.clock)();
        let (start, reached) = match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => (f.corner().start, f.forward_to_corner(gradient)),
            Preconditioner::Factor { single, .. } => (single.corner().start, single.forward_to_corner(gradient)),
            Preconditioner::Vertices(_) => return active,
        };
        let mut active = active;
        let mut d = vec![0.0; gradient.len()];
        for _ in 0..MAX_GUESSES {
            let terms: Vec<RankOne> = active.iter().map(|&i| contact[i].clone()).collect();
            self.correct(&terms);
            let mut y: Vec<f64> = reached.iter().map(|g| -g).collect();
            match &self.low_rank {
                Some(low_rank) => {
                    low_rank.add_loads(&active.iter().map(|&i| loads[i]).collect::<Vec<_>>(), &mut y);
                    low_rank.apply(&mut y);
                }
                None if active.is_empty() => {}
                None => break,
            }
            match &mut self.preconditioner {
                Preconditioner::Factor { double: Some(f), .. } => f.corner_transpose_solve(&mut y),
                Preconditioner::Factor { single, .. } => single.corner_transpose_solve(&mut y),
                Preconditioner::Vertices(_) => break,
            }
            d[start..].copy_from_slice(&y);
            let next: Vec<usize> = (0..contact.len()).filter(|&i| pushes(&d, i)).collect();
            if next == active {
                break;
            }
            active = next;
        }
        self.times.1 += (self.clock)() - begin;
        active
    }

    /// Solves `A x = b` until the error's energy norm, as the preconditioner sees it, has fallen by `tolerance`.
    ///
    /// `values` are those of `A`, `elastic` those without the terms `contact`.
    pub(super) fn solve(
        &mut self,
        pattern: &Pattern,
        System { values, elastic, contact }: System<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
    ) -> Result<Work, Indefinite> {
        x.fill(0.0);
        let mut at = Iterate { r: b.to_vec(), start: None, iterations: 0 };
        let (mut factorised, mut whole) = (false, false);
        let begin = (self.clock)();
        self.correct(contact);
        self.times.1 += (self.clock)() - begin;
        loop {
            let fresh = factorised;
            if fresh || (self.has_factor() && !self.stale) {
                let limit = match (self.relaxes(), fresh) {
                    (true, _) => MAX_RELAXATIONS,
                    (false, true) => MAX_WITH_NEW,
                    (false, false) => MAX_WITH_OLD,
                };
                let begin = (self.clock)();
                let outcome = self.iterate(pattern, values, x, &mut at, tolerance, limit);
                self.times.1 += (self.clock)() - begin;
                match outcome {
                    Outcome::Solved => return Ok(Work { factorised, cg_iterations: at.iterations }),
                    Outcome::Indefinite => return Err(Indefinite),
                    // Curved contact may be more than what the factor is told of it.
                    Outcome::Slow if fresh && !self.whole && !contact.is_empty() => whole = true,
                    Outcome::Slow if fresh && self.is_double() => {
                        // As good as it gets.
                        return Ok(Work { factorised, cg_iterations: at.iterations });
                    }
                    Outcome::Slow if fresh => self.use_double(),
                    Outcome::Slow => {}
                }
            }
            let begin = (self.clock)();
            let done = self.factorise(pattern, values, elastic, whole, !contact.is_empty());
            self.times.0 += (self.clock)() - begin;
            self.low_rank = None;
            done?;
            self.correct(contact);
            factorised = true;
            self.stale = false;
        }
    }

    fn factorise(
        &mut self,
        pattern: &Pattern,
        values: &[f64],
        elastic: &[f64],
        whole: bool,
        touches: bool,
    ) -> Result<(), Indefinite> {
        match &mut self.preconditioner {
            Preconditioner::Factor { single, double, .. } => {
                let mut factorise = |values: &[f64]| {
                    self.factorisations += 1;
                    match double {
                        Some(factor) => factor.factorise(values),
                        None => single.factorise(values),
                    }
                };
                let of_elements = if whole { Err(Indefinite) } else { factorise(elastic) };
                self.whole = touches && of_elements.is_err();
                if self.whole { factorise(values) } else { of_elements }
            }
            Preconditioner::Vertices(inverses) => {
                *inverses = pattern.inverse_diagonal(values).ok_or(Indefinite)?;
                Ok(())
            }
        }
    }

    /// Goes over to double precision, when there is memory for it.
    pub(super) fn use_double(&mut self) {
        if let Preconditioner::Factor { symbolic, double, .. } = &mut self.preconditioner
            && double.is_none()
        {
            *double = Factor::new(Arc::clone(symbolic)).ok().map(Box::new);
        }
    }

    /// Whether factors are in double precision already.
    pub(super) fn is_double(&self) -> bool {
        match &self.preconditioner {
            Preconditioner::Factor { double, .. } => double.is_some(),
            Preconditioner::Vertices(_) => true,
        }
    }

    fn iterate(
        &mut self,
        pattern: &Pattern,
        values: &[f64],
        x: &mut [f64],
        at: &mut Iterate,
        tolerance: f64,
        limit: usize,
    ) -> Outcome {
        let mut z = at.r.clone();
        self.precondition(&mut z);
        let mut p = z.clone();
        let mut ap = vec![0.0; x.len()];
        let mut rz = dot(&at.r, &z);
        let begin = rz;
        let goal = tolerance * tolerance * *at.start.get_or_insert(begin);
        if rz <= goal {
            return if rz.is_finite() { Outcome::Solved } else { Outcome::Indefinite };
        }
        for iteration in 1..=limit {
            pattern.multiply(values, &p, &mut ap);
            let curvature = dot(&p, &ap);
            at.iterations += 1;
            if !(curvature > 0.0 && rz.is_finite()) {
                return Outcome::Indefinite;
            }
            let alpha = rz / curvature;
            for i in 0..x.len() {
                x[i] += alpha * p[i];
                at.r[i] -= alpha * ap[i];
            }
            z.copy_from_slice(&at.r);
            self.precondition(&mut z);
            let next = dot(&at.r, &z);
            if next <= goal {
                return Outcome::Solved;
            }
            // At this rate it will not get there.
            let rate = (next / begin).powf(1.0 / iteration as f64);
            if iteration >= 3 && limit < MAX_RELAXATIONS && next * rate.powf((limit - iteration) as f64) > goal {
                return Outcome::Slow;
            }
            let beta = next / rz;
            rz = next;
            for i in 0..x.len() {
                p[i] = z[i] + beta * p[i];
            }
        }
        Outcome::Slow
    }
}

/// Sum in index order.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
