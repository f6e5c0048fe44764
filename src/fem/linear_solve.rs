//! Linear systems of Newton's method: conjugate gradients in double precision, preconditioned by a Cholesky factor in single
//! precision, which is kept while it serves. Measured on 81 135 unknowns, a single factor takes half the memory, 0.6 of the
//! time to make and 0.4 of the time to apply; with a fresh one, one or two iterations solve the system.

use super::assembly::Pattern;
use super::error::SolveError;
use super::factor::{Factor, Indefinite, Symbolic};
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
    factorisations: usize,
    /// The factor does not belong to a matrix like the next one.
    stale: bool,
}

/// What conjugate gradients are preconditioned by.
#[derive(Debug)]
enum Preconditioner {
    /// A Cholesky factor of the whole matrix.
    Factor {
        symbolic: Arc<Symbolic>,
        single: Factor<f32>,
        /// Made when a matrix defeats the single one; used from then on.
        double: Option<Factor<f64>>,
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
    /// Symbolic analysis and room for the factor.
    pub(super) fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        let symbolic = Arc::new(Symbolic::new(pattern)?);
        let single = Factor::new(Arc::clone(&symbolic))?;
        let preconditioner = Preconditioner::Factor { symbolic, single, double: None };
        Ok(Self { preconditioner, factorisations: 0, stale: false })
    }

    /// Relaxation of vertices under the forces of their neighbours, without any factor.
    pub(super) fn relaxation() -> Self {
        Self { preconditioner: Preconditioner::Vertices(Vec::new()), factorisations: 0, stale: false }
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
                double.as_ref().map_or(single.is_valid(), Factor::is_valid)
            }
            Preconditioner::Vertices(inverses) => !inverses.is_empty(),
        }
    }

    /// Applies the last factor, which may belong to an older matrix.
    pub(super) fn precondition(&mut self, x: &mut [f64]) {
        match &mut self.preconditioner {
            Preconditioner::Factor { double: Some(factor), .. } => factor.solve(x),
            Preconditioner::Factor { single, .. } => single.solve(x),
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

    /// Solves `A x = b` until the error's energy norm, as the preconditioner sees it, has fallen by `tolerance`.
    pub(super) fn solve(
        &mut self,
        pattern: &Pattern,
        values: &[f64],
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
    ) -> Result<Work, Indefinite> {
        x.fill(0.0);
        let mut at = Iterate { r: b.to_vec(), start: None, iterations: 0 };
        let mut factorised = false;
        loop {
            let fresh = factorised;
            if fresh || (self.has_factor() && !self.stale) {
                let limit = match (self.relaxes(), fresh) {
                    (true, _) => MAX_RELAXATIONS,
                    (false, true) => MAX_WITH_NEW,
                    (false, false) => MAX_WITH_OLD,
                };
                match self.iterate(pattern, values, x, &mut at, tolerance, limit) {
                    Outcome::Solved => return Ok(Work { factorised, cg_iterations: at.iterations }),
                    Outcome::Indefinite => return Err(Indefinite),
                    Outcome::Slow if fresh && self.is_double() => {
                        // As good as it gets.
                        return Ok(Work { factorised, cg_iterations: at.iterations });
                    }
                    Outcome::Slow if fresh => self.use_double(),
                    Outcome::Slow => {}
                }
            }
            self.factorise(pattern, values)?;
            factorised = true;
            self.stale = false;
        }
    }

    fn factorise(&mut self, pattern: &Pattern, values: &[f64]) -> Result<(), Indefinite> {
        match &mut self.preconditioner {
            Preconditioner::Factor { single, double, .. } => {
                self.factorisations += 1;
                match double {
                    Some(factor) => factor.factorise(values),
                    None => single.factorise(values),
                }
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
            *double = Factor::new(Arc::clone(symbolic)).ok();
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
