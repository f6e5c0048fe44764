//! Linear systems of Newton's method: conjugate gradients in double precision, preconditioned by a Cholesky factor in single
//! precision.
//!
//! A factor is reused for later matrices while it converges fast enough. Measured on 81 135 unknowns, a factor in single
//! precision takes half the memory of one in double precision, 0.6 of the time to compute and 0.4 of the time to apply; a new
//! factor solves the system in one or two iterations.

use super::assembly::Pattern;
use super::compliance::{Compliance, LowRank, RankOne};
use super::coupling::Coupling;
use super::dot::dot;
use super::factor::{Factor, Indefinite, Symbolic};
use super::failure::Failure;
use super::tuning::{
    ITERATIONS_FOR_RATE, MAX_EXTRA_ITERATIONS, MAX_RELAXATIONS, MAX_WITH_NEW, MAX_WITH_OLD, RELAXATION_TOLERANCE,
};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
use prosopon_geometry::control::Control;
use std::sync::Arc;

/// A matrix, its elastic part and its contact terms.
#[derive(Debug, Clone, Copy)]
pub(super) struct System<'a> {
    pub(super) values: &'a [f64],
    /// Contact terms outside the pattern of `values`.
    pub(super) coupling: &'a Coupling,
    /// Values without contact.
    pub(super) elastic: &'a [f64],
    /// The Gauss-Newton terms of contact; the curvature of contact is not among them.
    pub(super) contact: &'a [RankOne],
}

/// Cost of one solve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Work {
    pub(super) factorised: bool,
    pub(super) cg_iterations: usize,
}

/// Times of a linear solver.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SolverTimes {
    /// Factorisations, s.
    pub(super) factor_s: f64,
    /// Solves, s.
    pub(super) solve_s: f64,
}

/// Matrix to factorise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FactorMatrix {
    /// That of the elements.
    Elements,
    /// That of the elements, or the whole one when the elements alone are not stable.
    ElementsOrWhole,
    /// The whole one, with contact.
    Whole,
}

/// Conjugate gradients with their preconditioner.
#[derive(Debug)]
pub(super) struct LinearSolver {
    preconditioner: Preconditioner,
    /// Correction for contact terms that the factor does not include.
    low_rank: Option<LowRank>,
    /// Compliance of the nodes on which contact has acted since the factor was computed.
    compliance: Option<Compliance>,
    /// Whether the factor includes contact, because the elements alone are not stable.
    includes_contact: bool,
    factorisations: usize,
    /// Stop flag and clock of the caller.
    control: Control,
    times: SolverTimes,
    /// Whether the factor must be computed anew for the next matrix.
    is_stale: bool,
    /// Extra iterations so far that were caused by the factor's age.
    extra_iterations: usize,
}

/// Preconditioner of the conjugate gradients.
#[derive(Debug)]
enum Preconditioner {
    /// A Cholesky factor of the whole matrix.
    Factor {
        symbolic: Arc<Symbolic>,
        /// Shared with other solvers while it is the factor at rest.
        single: Arc<Factor<f32>>,
        /// Computed when single precision fails for a matrix; used from then on.
        double: Option<Box<Factor<f64>>>,
    },
    /// Inverse 3x3 tensors of the vertices (block Jacobi): in one iteration only forces of neighbours act on a vertex.
    Vertices(Vec<Matrix3<f64>>),
}

impl std::fmt::Debug for Symbolic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Symbolic")
    }
}

/// State of the conjugate gradients.
struct Iterate {
    /// Residual b - A x.
    r: Vec<f64>,
    /// Value of `r·z` at x = 0, with the first preconditioner that was applied.
    start: Option<f64>,
    iterations: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Solved,
    Slow,
    Indefinite,
    Cancelled,
}

impl LinearSolver {
    /// A solver with this factor: of the matrix that is solved first, or without values.
    pub(super) fn new(symbolic: Arc<Symbolic>, factor: Arc<Factor<f32>>, control: &Control) -> Self {
        Self::with(Preconditioner::Factor { symbolic, single: factor, double: None }, control)
    }

    /// Relaxation of vertices under the forces of their neighbours, without a factor.
    pub(super) fn relaxation(control: &Control) -> Self {
        Self::with(Preconditioner::Vertices(Vec::new()), control)
    }

    fn with(preconditioner: Preconditioner, control: &Control) -> Self {
        Self {
            preconditioner,
            low_rank: None,
            compliance: None,
            includes_contact: false,
            factorisations: 0,
            control: control.clone(),
            times: SolverTimes::default(),
            is_stale: false,
            extra_iterations: 0,
        }
    }

    /// From now on `control` stops the solver and gives the time.
    pub(super) fn set_control(&mut self, control: &Control) {
        self.control = control.clone();
    }

    fn now(&self) -> f64 {
        (self.control.clock())()
    }

    /// Resets the times to zero.
    pub(super) fn forget_times(&mut self) {
        self.times = SolverTimes::default();
    }

    /// Times so far.
    pub(super) fn times(&self) -> SolverTimes {
        self.times
    }

    fn relaxes(&self) -> bool {
        matches!(self.preconditioner, Preconditioner::Vertices(_))
    }

    /// Tolerance to solve with when `wanted` suffices for a factor: block Jacobi gives a poor estimate of the remaining error.
    pub(super) fn tolerance(&self, wanted: f64) -> f64 {
        if self.relaxes() { wanted.min(RELAXATION_TOLERANCE) } else { wanted }
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

    /// Whether there is a factor and it may be used for the next matrix.
    pub(super) fn is_usable(&self) -> bool {
        self.has_factor() && !self.is_stale
    }

    /// Whether the preconditioner can be rebuilt from the elements alone, without contact.
    pub(super) fn can_be_restored(&self) -> bool {
        !self.includes_contact
    }

    /// Inverse tensors with which the vertices are relaxed; `None` without relaxation.
    pub(super) fn vertices(&self) -> Option<&[Matrix3<f64>]> {
        match &self.preconditioner {
            Preconditioner::Factor { .. } => None,
            Preconditioner::Vertices(inverses) => Some(inverses),
        }
    }

    /// Sets these tensors; `None` when this solver does not relax.
    pub(super) fn set_vertices(&mut self, tensors: Vec<Matrix3<f64>>) -> Option<()> {
        match &mut self.preconditioner {
            Preconditioner::Factor { .. } => None,
            Preconditioner::Vertices(inverses) => {
                *inverses = tensors;
                self.is_stale = false;
                Some(())
            }
        }
    }

    /// Applies the current factor, which may belong to an older matrix.
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

    /// Marks the factor as stale, so that the next system is factorised at once.
    pub(super) fn refresh(&mut self) {
        self.is_stale = true;
    }

    /// Factorises the elements' matrix when there is no usable factor.
    pub(super) fn prepare(&mut self, pattern: &Pattern, elastic: &[f64]) {
        if !self.relaxes() && !self.is_usable() {
            let begin = self.now();
            // A failure is reported when the system is solved.
            self.is_stale = self.factorise(pattern, elastic, elastic, FactorMatrix::Elements).is_err();
            self.times.factor_s += self.now() - begin;
        }
    }

    /// Sets the low-rank correction for the contact terms.
    fn set_contact_correction(&mut self, contact: &[RankOne]) {
        self.low_rank = None;
        if contact.is_empty() || self.includes_contact || self.relaxes() || !self.has_factor() {
            return;
        }
        let nodes = contact.iter().flat_map(|t| t.nodes.iter().map(|(node, _)| *node));
        let control = self.control.clone();
        self.low_rank = self.compliance(nodes).and_then(|compliance| LowRank::new(contact, compliance, &control));
    }

    /// Approximate solution of `A x = b` by the current factor and the terms `contact`, without conjugate gradients.
    pub(super) fn estimate(&mut self, contact: &[RankOne], b: &[f64]) -> Vec<f64> {
        let begin = self.now();
        self.set_contact_correction(contact);
        let mut x = b.to_vec();
        self.precondition(&mut x);
        self.times.solve_s += self.now() - begin;
        x
    }

    /// `L⁻¹ b` of the current factor. `None` when there is no usable one, or when it includes contact.
    pub(super) fn forward(&mut self, b: &[f64]) -> Option<Vec<f64>> {
        if self.includes_contact || !self.is_usable() {
            return None;
        }
        let begin = self.now();
        let y = match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.forward(b),
            Preconditioner::Factor { single, .. } => single.forward(b),
            Preconditioner::Vertices(_) => return None,
        };
        self.times.solve_s += self.now() - begin;
        Some(y)
    }

    /// `L⁻ᵀ y` of the current factor.
    pub(super) fn backward(&mut self, y: &[f64]) -> Vec<f64> {
        let begin = self.now();
        let x = match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.backward(y),
            Preconditioner::Factor { single, .. } => single.backward(y),
            Preconditioner::Vertices(_) => y.to_vec(),
        };
        self.times.solve_s += self.now() - begin;
        x
    }

    /// The rows of [`LinearSolver::backward`] from the corner on.
    pub(super) fn corner_backward(&self, y: &mut [f64]) {
        match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => f.corner_transpose_solve(y),
            Preconditioner::Factor { single, .. } => single.corner_transpose_solve(y),
            Preconditioner::Vertices(_) => {}
        }
    }

    /// Range of the unknowns in the corner.
    pub(super) fn corner(&self) -> std::ops::Range<usize> {
        match &self.preconditioner {
            Preconditioner::Factor { single, .. } => single.corner(),
            Preconditioner::Vertices(_) => 0..0,
        }
    }

    /// Compliance of the nodes added so far.
    pub(super) fn known_compliance(&self) -> Option<&Compliance> {
        self.compliance.as_ref()
    }

    /// Compliance of at least the `nodes`, as computed by the current factor; `None` when a node lies outside the corner.
    pub(super) fn compliance(&mut self, nodes: impl Iterator<Item = u32>) -> Option<&Compliance> {
        let corner = self.corner();
        let compliance = self.compliance.get_or_insert_with(|| Compliance::new(corner));
        match &self.preconditioner {
            Preconditioner::Factor { double: Some(f), .. } => {
                compliance.add(nodes, &self.control, |first, b| f.corner_solve(first, b))
            }
            Preconditioner::Factor { single, .. } => {
                compliance.add(nodes, &self.control, |first, b| single.corner_solve(first, b))
            }
            Preconditioner::Vertices(_) => None,
        }?;
        Some(compliance)
    }

    /// Solves `A x = b` until the energy norm of the error, as estimated with the preconditioner, has fallen by the factor
    /// `tolerance`.
    ///
    /// `values` are those of `A`, `elastic` those without the terms `contact`. `tolerance` is relative to the energy norm whose
    /// square is `norm_sq`, or to that of `x` when `norm_sq` is `None`.
    pub(super) fn solve(
        &mut self,
        pattern: &Pattern,
        system: System<'_>,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
        norm_sq: Option<f64>,
    ) -> Result<Work, Failure> {
        let System { values, elastic, contact, .. } = system;
        x.fill(0.0);
        let mut at = Iterate { r: b.to_vec(), start: norm_sq, iterations: 0 };
        let mut factorised = false;
        let mut matrix = if contact.is_empty() { FactorMatrix::Elements } else { FactorMatrix::ElementsOrWhole };
        let begin = self.now();
        self.set_contact_correction(contact);
        self.times.solve_s += self.now() - begin;
        loop {
            let fresh = factorised;
            if fresh || (self.is_usable() && self.extra_iterations <= MAX_EXTRA_ITERATIONS) {
                let limit = match (self.relaxes(), fresh) {
                    (true, _) => MAX_RELAXATIONS,
                    (false, true) => MAX_WITH_NEW,
                    (false, false) => MAX_WITH_OLD,
                };
                let begin = self.now();
                let outcome = self.iterate(pattern, system, x, &mut at, tolerance, limit);
                self.times.solve_s += self.now() - begin;
                match outcome {
                    Outcome::Solved => {
                        self.add_loss(at.iterations.saturating_sub(1));
                        return Ok(Work { factorised, cg_iterations: at.iterations });
                    }
                    Outcome::Indefinite => return Err(Failure::Indefinite),
                    Outcome::Cancelled => return Err(Failure::Cancelled),
                    // The curvature of contact may be too large for the Gauss-Newton terms of the correction.
                    Outcome::Slow if fresh && !self.includes_contact && !contact.is_empty() => {
                        matrix = FactorMatrix::Whole;
                    }
                    Outcome::Slow if fresh && self.is_double() => {
                        // A new factor in double precision is the best preconditioner available.
                        return Ok(Work { factorised, cg_iterations: at.iterations });
                    }
                    Outcome::Slow if fresh => self.use_double(),
                    Outcome::Slow => {}
                }
            }
            self.control.check()?;
            let begin = self.now();
            let done = self.factorise(pattern, values, elastic, matrix);
            self.times.factor_s += self.now() - begin;
            done?;
            self.set_contact_correction(contact);
            factorised = true;
            self.is_stale = false;
        }
    }

    /// Extra iterations so far that were caused by the factor's age.
    pub(super) fn extra_iterations(&self) -> usize {
        self.extra_iterations
    }

    /// Adds iterations caused by the factor's age. Once they cost as much as a factorisation, the next system is factorised.
    pub(super) fn add_loss(&mut self, iterations: usize) {
        if !self.relaxes() && !self.includes_contact {
            self.extra_iterations += iterations;
        }
    }

    fn factorise(
        &mut self,
        pattern: &Pattern,
        values: &[f64],
        elastic: &[f64],
        matrix: FactorMatrix,
    ) -> Result<(), Indefinite> {
        (self.low_rank, self.compliance) = (None, None);
        self.extra_iterations = 0;
        match &mut self.preconditioner {
            Preconditioner::Factor { symbolic, single, double } => {
                let mut factorise = |values: &[f64]| {
                    self.factorisations += 1;
                    if let Some(factor) = double {
                        return factor.factorise(values);
                    }
                    if Arc::get_mut(single).is_none() {
                        // Other solvers keep the shared factor.
                        *single = Arc::new(Factor::new(Arc::clone(symbolic)).map_err(|_| Indefinite)?);
                    }
                    Arc::get_mut(single).ok_or(Indefinite)?.factorise(values)
                };
                let of_elements = match matrix {
                    FactorMatrix::Elements | FactorMatrix::ElementsOrWhole => factorise(elastic),
                    FactorMatrix::Whole => Err(Indefinite),
                };
                self.includes_contact = matrix != FactorMatrix::Elements && of_elements.is_err();
                if self.includes_contact { factorise(values) } else { of_elements }
            }
            Preconditioner::Vertices(inverses) => {
                *inverses = pattern.inverse_diagonal(values).ok_or(Indefinite)?;
                Ok(())
            }
        }
    }

    /// Switches to double precision, if the memory suffices.
    pub(super) fn use_double(&mut self) {
        if let Preconditioner::Factor { symbolic, double, .. } = &mut self.preconditioner
            && double.is_none()
        {
            *double = Factor::new(Arc::clone(symbolic)).ok().map(Box::new);
            (self.low_rank, self.compliance) = (None, None);
        }
    }

    /// Whether factors are in double precision.
    pub(super) fn is_double(&self) -> bool {
        match &self.preconditioner {
            Preconditioner::Factor { double, .. } => double.is_some(),
            Preconditioner::Vertices(_) => true,
        }
    }

    fn iterate(
        &mut self,
        pattern: &Pattern,
        System { values, coupling, .. }: System<'_>,
        x: &mut [f64],
        at: &mut Iterate,
        tolerance: f64,
        limit: usize,
    ) -> Outcome {
        let mut z = at.r.clone();
        self.precondition(&mut z);
        let (mut p, mut ap) = (z.clone(), vec![0.0; x.len()]);
        let mut rz = dot(&at.r, &z);
        let begin = rz;
        let goal = tolerance * tolerance * *at.start.get_or_insert(begin);
        if rz <= goal {
            return if rz.is_finite() { Outcome::Solved } else { Outcome::Indefinite };
        }
        for iteration in 1..=limit {
            if self.control.is_cancelled() {
                return Outcome::Cancelled;
            }
            pattern.multiply(values, &p, &mut ap);
            coupling.add_product(&p, &mut ap);
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
            // At this rate the iteration limit would be reached first.
            let rate = (next / begin).powf(1.0 / iteration as f64);
            if iteration >= ITERATIONS_FOR_RATE
                && limit < MAX_RELAXATIONS
                && next * rate.powf((limit - iteration) as f64) > goal
            {
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
