//! Static equilibrium of one mesh under moving bone, advanced along a path.

use super::contact::NoncontactPoints;
use super::element::C1Surface;
use super::equations::Equations;
use super::error::SolveError;
use super::failure::Failure;
use super::report::{CellState, IterationRecord, StepReport};
use super::settings::{Boundary, ContactBody, SolveSettings};
use super::setup::{PreparationWork, Prepared};
use super::state::{PathPoint, Purpose};
use super::tuning::{MAX_HALVINGS, MAX_WASTED};
use super::{diagnosis, setup};
use crate::mesh::MixedMesh;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector, Warning};
use std::sync::Arc;

/// Static equilibrium of one mesh under moving bone, advanced along a path.
#[derive(Debug)]
pub struct Solver<'a> {
    pub(super) mesh: &'a MixedMesh,
    surface: Option<Arc<C1Surface>>,
    pub(super) settings: SolveSettings,
    pub(super) equations: Equations<'a>,
    pub(super) noncontact: NoncontactPoints,
    /// Segments whose reactions are reported, ascending.
    pub(super) segments: Vec<u32>,
    /// The last equilibrium.
    pub(super) reached: PathPoint,
    /// Length of the last substep that converged.
    pub(super) substep: f64,
    /// Whether stable materials have replaced those requested.
    pub(super) stabilised: bool,
    /// Whether a warning has been given of tissue that passed through bone, and of tissue that slipped round a rim.
    pub(super) warned_passage: [bool; 2],
    /// Warnings collected so far; the next report includes them.
    pub(super) warnings: Vec<Warning>,
    /// Work of the preparation, when this is the first solver over it; the first report includes it.
    pub(super) preparation: PreparationWork,
}

impl<'a> Solver<'a> {
    /// Sets up elements, unknowns and factorisation; the state is rest at path parameter 0.
    ///
    /// # Errors
    /// [`SolveError`] when elements are inverted at rest or the problem is inconsistent (for example when nothing is held).
    pub fn new(
        mesh: &'a MixedMesh,
        bodies: Vec<ContactBody<'a>>,
        settings: SolveSettings,
        control: &Control,
    ) -> Result<Self, SolveError> {
        Self::with_boundary(mesh, bodies, &Boundary::default(), settings, control)
    }

    /// [`Solver::new`] with held axes and dead loads.
    ///
    /// # Errors
    /// As [`Solver::new`].
    pub fn with_boundary(
        mesh: &'a MixedMesh,
        bodies: Vec<ContactBody<'a>>,
        boundary: &Boundary,
        settings: SolveSettings,
        control: &Control,
    ) -> Result<Self, SolveError> {
        let prepared = Prepared::new(mesh, &bodies, boundary, settings, &control.stage(0.0, 0.9))?;
        Self::over(&prepared, mesh, bodies, &control.stage(0.9, 1.0))
    }

    /// A solver that starts from a [`Prepared`] for `mesh`.
    ///
    /// # Errors
    /// [`SolveError`] when a segment is given twice, or when the mesh differs in size from the prepared one.
    pub fn over(
        prepared: &Prepared,
        mesh: &'a MixedMesh,
        bodies: Vec<ContactBody<'a>>,
        control: &Control,
    ) -> Result<Self, SolveError> {
        let begin = (control.clock())();
        let mut segments = setup::tied_segments(mesh);
        segments.extend(bodies.iter().map(|b| b.segment));
        segments.sort_unstable();
        segments.dedup();
        let (mut equations, warnings) = prepared.equations(mesh, bodies, control)?;
        let noncontact = prepared.noncontact(mesh, equations.state.contact.bodies());
        equations.work.times_mut().setup_s = (control.clock())() - begin;
        let reached = PathPoint { t: 0.0, x: equations.problem.dofs().rest().to_vec(), motions: Vec::new() };
        control.report(1.0);
        Ok(Self {
            mesh,
            surface: prepared.surface.clone(),
            settings: prepared.settings.clone(),
            equations,
            noncontact,
            segments,
            reached,
            substep: f64::INFINITY,
            stabilised: false,
            warned_passage: [false; 2],
            warnings,
            preparation: prepared.unreported_work(),
        })
    }

    /// Advances from the current path parameter to `t`.
    ///
    /// `motions(t)` lists each moving segment's motion from rest; segments that it does not list stay at rest. The solver chooses
    /// the substeps. On error the state stays at the last converged substep.
    ///
    /// # Errors
    /// [`SolveError`] when no equilibrium is found, or when `control` cancels.
    pub fn advance(
        &mut self,
        t: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
        control: &Control,
    ) -> Result<StepReport, SolveError> {
        if !t.is_finite() {
            return Err(SolveError::Problem { detail: format!("the path parameter is {t}; it must be finite") });
        }
        self.equations.watch(control);
        self.equations.state.records.clear();
        let from = self.reached.t;
        let factorisations = self.equations.work.solver().factorisations();
        let mut progress = Progress::default();
        let found = loop {
            control.check()?;
            let remaining = t - self.reached.t;
            let wanted = remaining.abs().min(self.substep);
            let length = self.limit_contact_motion(wanted, remaining.signum(), motions);
            let goal =
                if length >= remaining.abs() * (1.0 - 1e-9) { t } else { self.reached.t + length * remaining.signum() };
            let before = self.equations.state.records.len();
            match self.substep_to(goal, motions) {
                Ok(found) => {
                    progress.substeps += 1;
                    progress.iterations += found.iterations;
                    if self.substep.is_finite() {
                        self.substep *= 2.0;
                    }
                    control.report(if t == from { 1.0 } else { (goal - from) / (t - from) });
                    if self.stabilise(goal) {
                        continue;
                    }
                    if goal == t {
                        break found;
                    }
                }
                Err(Failure::Cancelled) => return Err(prosopon_geometry::control::Cancelled.into()),
                Err(failure) => {
                    progress.halvings += 1;
                    progress.wasted += self.equations.state.records.len() - before;
                    self.substep = 0.5 * length;
                    let is_spent = progress.wasted > MAX_WASTED || progress.halvings > MAX_HALVINGS;
                    if self.substep < self.settings.min_substep || length == 0.0 || is_spent {
                        if self.stabilise(goal) {
                            self.substep = length;
                            continue;
                        }
                        return Err(diagnosis::name(&self.equations, self.mesh, failure, goal, &self.reached.x));
                    }
                }
            }
        };
        Ok(self.report(&found, &progress, self.equations.work.solver().factorisations() - factorisations))
    }

    /// [`Solver::advance`] to a tolerance that suffices for display, not for measurement.
    ///
    /// The active set has converged, the residual is within 1e-2 of the reactions, and the estimated remaining displacement is at
    /// most 5e-3 of the element size (0.02 mm for 4 mm). Use [`Solver::advance`] for a step on which something is measured.
    ///
    /// # Errors
    /// As [`Solver::advance`].
    pub fn advance_for_display(
        &mut self,
        t: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
        control: &Control,
    ) -> Result<StepReport, SolveError> {
        self.equations.state.purpose = Purpose::Display;
        let found = self.advance(t, motions, control);
        self.equations.state.purpose = Purpose::Measurement;
        found
    }

    /// Drops warnings and times that another solver has already reported.
    pub(super) fn forget_reported(&mut self) {
        self.warnings.clear();
        self.preparation = PreparationWork::default();
    }

    /// Current positions of the mesh nodes, LPS mm, in the order of the mesh.
    #[must_use]
    pub fn positions(&self) -> Vec<Point> {
        self.reached.x[..self.mesh.positions.len()].iter().map(|x| Point::from(*x)).collect()
    }

    /// Number of unknowns.
    #[must_use]
    pub fn n_unknowns(&self) -> usize {
        self.equations.problem.dofs().n_scalar()
    }

    /// Path parameter of the current state.
    #[must_use]
    pub fn path_parameter(&self) -> f64 {
        self.reached.t
    }

    /// Displacement (mm) of the point of the outer surface at barycentric `l` of prism `prism`.
    ///
    /// It is interpolated with the skin element's own shape functions; zero when there is no such prism.
    #[must_use]
    pub fn outer_displacement(&self, prism: u32, l: [f64; 3]) -> Vector {
        let prism = prism as usize;
        let Some(corners) = self.mesh.prisms.get(prism) else { return Vector::zeros() };
        let moved = |node: u32| self.reached.x[node as usize] - self.equations.problem.dofs().rest()[node as usize];
        match &self.surface {
            Some(surface) => {
                let functions = surface.outer_functions(self.mesh, prism, l);
                let nodes = surface.outer_nodes_of(self.mesh, prism);
                nodes.iter().zip(functions).map(|(&node, n)| moved(node) * n).sum()
            }
            None => corners[..3].iter().zip(l).map(|(&node, l)| moved(node) * l).sum(),
        }
    }

    /// Cauchy stress and volume ratio of every tetrahedron and of every prism at the current state.
    #[must_use]
    pub fn cell_states(&self) -> (Vec<CellState>, Vec<CellState>) {
        super::cell_states::cell_states(self.equations.problem.assembly(), self.mesh, &self.reached.x)
    }

    /// Newton iterations of the last call of [`Solver::advance`].
    #[must_use]
    pub fn iterations(&self) -> &[IterationRecord] {
        &self.equations.state.records
    }
}

/// Counts of one call of [`Solver::advance`].
#[derive(Debug, Default)]
pub(super) struct Progress {
    pub(super) substeps: usize,
    pub(super) iterations: usize,
    pub(super) halvings: usize,
    /// Iterations of substeps that did not converge.
    pub(super) wasted: usize,
}
