//! Linear systems of Newton's method: conjugate gradients in double precision, preconditioned by a Cholesky factor in single
//! precision, which is kept while it serves. Measured on 81 135 unknowns, a single factor takes half the memory, 0.6 of the
//! time to make and 0.4 of the time to apply; with a fresh one, one or two iterations solve the system.

use super::assembly::Pattern;
use super::compliance::{Compliance, LowRank};
use super::contact::RankOne;
use super::factor::{Factor, Indefinite, Symbolic};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
use prosopon_geometry::control::Clock;
use std::sync::Arc;

/// Iterations with an older factor after which a new one is cheaper: a factorisation costs about as much as 15 solves.
const MAX_WITH_OLD: usize = 12;
/// Iterations that an older factor may cost in all beyond those of a new one: what a factorisation costs (27 iterations on 153 657 unknowns). Waiting until
/// the loss equals the price costs at most twice what the best moment, known beforehand, would.
const MAX_LOST: usize = 27;
/// Iterations with a new factor after which single precision is held to be too coarse for the matrix.
const MAX_WITH_NEW: usize = 25;
/// Iterations of relaxation before it is given up.
const MAX_RELAXATIONS: usize = 20_000;
/// Tolerance of relaxation.
const RELAXED: f64 = 1e-9;

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
    /// Of the nodes that contact acted on since the factor was made.
    compliance: Option<Compliance>,
    /// The factor knows of contact, because elements alone are not stable.
    whole: bool,
    factorisations: usize,
    clock: Clock,
    /// Time of factorisations and of solves, s.
    times: (f64, f64),
    /// The factor does not belong to a matrix like the next one.
    stale: bool,
    /// Iterations that its age has cost so far.
    lost: usize,
}

/// What conjugate gradients are preconditioned by.
#[derive(Debug)]
enum Preconditioner {
    /// A Cholesky factor of the whole matrix.
    Factor {
        symbolic: Arc<Symbolic>,
        /// Shared while it is that of the state at rest.
        single: Arc<Factor<f32>>,
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
    /// A solver with this factor, of the matrix that is solved for first or without values.
    pub(super) fn new(symbolic: Arc<Symbolic>, factor: Arc<Factor<f32>>, clock: Clock) -> Self {
        Self::with(Preconditioner::Factor { symbolic, single: factor, double: None }, clock)
    }

    /// Relaxation of vertices under the forces of their neighbours, without any factor.
    pub(super) fn relaxation(clock: Clock) -> Self {
        Self::with(Preconditioner::Vertices(Vec::new()), clock)
    }

    fn with(preconditioner: Preconditioner, clock: Clock) -> Self {
        Self {
            preconditioner,
            low_rank: None,
            compliance: None,
            whole: false,
            factorisations: 0,
            clock,
            times: (0.0, 0.0),
            stale: false,
            lost: 0,
        }
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

    /// Whether the present factor belongs to a matrix like the next one.
    pub(super) fn serves(&self) -> bool {
        self.has_factor() && !self.stale
    }

    /// Whether what is here in the place of a factor can be made again without contact.
    pub(super) fn can_be_restored(&self) -> bool {
        !self.whole
    }

    /// The inverse tensors that vertices are relaxed with.
    pub(super) fn vertices(&self) -> Option<&[Matrix3<f64>]> {
        match &self.preconditioner {
            Preconditioner::Factor { .. } => None,
            Preconditioner::Vertices(inverses) => Some(inverses),
        }
    }

    /// Sets them; `None` when this is no relaxation.
    pub(super) fn set_vertices(&mut self, tensors: Vec<Matrix3<f64>>) -> Option<()> {
        match &mut self.preconditioner {
            Preconditioner::Factor { .. } => None,
            Preconditioner::Vertices(inverses) => {
                *inverses = tensors;
                self.stale = false;
                Some(())
            }
        }
    }

    /// Applies the last factor, which may belong to an older matrix.
    pub(super) fn precondition(&mut self, x: &mut [f64]) {
        let contact = self.low_rank.as_ref().zip(self.compliance.as_ref());
        let between = |corner: &mut [f64]| {
            if let Some((low_rank, compliance)) = contact {
                low_rank.apply(compliance, corner);
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
        if !self.relaxes() && !self.serves() {
            let begin = (self.clock)();
            // A failure shows again when the system is solved.
            self.stale = self.factorise(pattern, elastic, elastic, false, false).is_err();
            self.times.0 += (self.clock)() - begin;
        }
    }

    /// Tells the factor of contact.
    fn correct(&mut self, contact: &[RankOne]) {
        self.low_rank = None;
        if contact.is_empty() || self.whole || self.relaxes() || !self.has_factor() {
            return;
        }
        let nodes = contact.iter().flat_map(|t| t.nodes.iter().map(|(node, _)| *node));
        self.low_rank = self.compliance(nodes).and_then(|compliance| LowRank::new(contact, compliance));
    }

    /// What the present factor with the terms `contact` has for `A x = b`, before any conjugate gradients.
    pub(super) fn estimate(&mut self, contact: &[RankOne], b: &[f64]) -> Vec<f64> {
        let begin = (self.clock)();
        self.correct(contact);
        let mut x = b.to_vec();
        self.precondition(&mut x);
        self.times.1 += (self.clock)() - begin;
        x
    }

    /// `L⁻¹ b` of the present factor. `None` when there is none that serves, or when it knows of contact.
    pub(super) fn forward(&mut self, b: &[f64]) -> Option<Vec<f64>> {
        if self.whole || !self.serves() {
            return None;
        }
        let begin = (self.clock)();
        let y = match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.forward(b),
            Preconditioner::Factor { single, .. } => single.forward(b),
            Preconditioner::Vertices(_) => return None,
        };
        self.times.1 += (self.clock)() - begin;
        Some(y)
    }

    /// `L⁻ᵀ y` of the present factor.
    pub(super) fn backward(&mut self, y: &[f64]) -> Vec<f64> {
        let begin = (self.clock)();
        let x = match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.backward(y),
            Preconditioner::Factor { single, .. } => single.backward(y),
            Preconditioner::Vertices(_) => y.to_vec(),
        };
        self.times.1 += (self.clock)() - begin;
        x
    }

    /// The part of [`LinearSolver::backward`] from the corner on.
    pub(super) fn corner_backward(&self, y: &mut [f64]) {
        match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.corner_transpose_solve(y),
            Preconditioner::Factor { single, .. } => single.corner_transpose_solve(y),
            Preconditioner::Vertices(_) => {}
        }
    }

    /// Unknowns from the corner on.
    pub(super) fn corner(&self) -> std::ops::Range<usize> {
        match &self.preconditioner {
            Preconditioner::Factor { single, .. } => single.corner(),
            Preconditioner::Vertices(_) => 0..0,
        }
    }

    /// Compliance of the nodes so far.
    pub(super) fn known_compliance(&self) -> Option<&Compliance> {
        self.compliance.as_ref()
    }

    /// Compliance of at least the `nodes`, as the present factor sees it; `None` when one lies outside of the corner.
    pub(super) fn compliance(&mut self, nodes: impl Iterator<Item = u32>) -> Option<&Compliance> {
        let corner = self.corner();
        let compliance = self.compliance.get_or_insert_with(|| Compliance::new(corner));
        match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => {
                compliance.add(nodes, |first, b| f.corner_solve(first, b))
            }
            Preconditioner::Factor { single, .. } => compliance.add(nodes, |first, b| single.corner_solve(first, b)),
            Preconditioner::Vertices(_) => None,
        }?;
        Some(compliance)
    }

    /// Solves `A x = b` until the error's energy norm, as the preconditioner sees it, has fallen by `tolerance`.
    ///
    /// `values` are those of `A`, `elastic` those without the terms `contact`. `norm_sq` is the square of the energy norm that `tolerance`
    /// is a share of; that of `x` itself when there is none.
    pub(super) fn solve(
        &mut self,
        pattern: &Pattern,
        System { values, elastic, contact }: System<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        norm_sq: Option<f64>,
    ) -> Result<Work, Indefinite> {
        x.fill(0.0);
        let mut at = Iterate { r: b.to_vec(), start: norm_sq, iterations: 0 };
        let (mut factorised, mut whole) = (false, false);
        let begin = (self.clock)();
        self.correct(contact);
        self.times.1 += (self.clock)() - begin;
        loop {
            let fresh = factorised;
            if fresh || (self.serves() && self.lost <= MAX_LOST) {
                let limit = match (self.relaxes(), fresh) {
                    (true, _) => MAX_RELAXATIONS,
                    (false, true) => MAX_WITH_NEW,
                    (false, false) => MAX_WITH_OLD,
                };
                let begin = (self.clock)();
                let outcome = self.iterate(pattern, values, x, &mut at, tolerance, limit);
                self.times.1 += (self.clock)() - begin;
                match outcome {
                    Outcome::Solved => {
                        self.lose(at.iterations.saturating_sub(1));
                        return Ok(Work { factorised, cg_iterations: at.iterations });
                    }
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
            done?;
            self.correct(contact);
            factorised = true;
            self.stale = false;
        }
    }

    /// Iterations that the present factor's age has cost.
    pub(super) fn lost(&self) -> usize {
        self.lost
    }

    /// Counts iterations that the present factor's age has cost; once they are worth a new one, the next system gets it.
    pub(super) fn lose(&mut self, iterations: usize) {
        if !self.relaxes() && !self.whole {
            self.lost += iterations;
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
        (self.low_rank, self.compliance) = (None, None);
        self.lost = 0;
        match &mut self.preconditioner {
            Preconditioner::Factor { symbolic, single, double } => {
                let mut factorise = |values: &[f64]| {
                    self.factorisations += 1;
                    if let Some(factor) = double {
                        return factor.factorise(values);
                    }
                    if Arc::get_mut(single).is_none() {
                        // Others go on with the shared one.
                        *single = Arc::new(Factor::new(Arc::clone(symbolic)).map_err(|_| Indefinite)?);
                    }
                    Arc::get_mut(single).ok_or(Indefinite)?.factorise(values)
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
            (self.low_rank, self.compliance) = (None, None);
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
