//! Static equilibrium of one mesh under moving bone, advanced along a path.

use super::contact::{Passage, Unguarded};
use super::element::C1Surface;
use super::equations::Equations;
use super::error::SolveError;
use super::newton::{Equilibrium, Failure, MAX_CONTACT_MOTION_MM};
use super::report::{CellState, IterationRecord, PhaseTimes, StepOutcome, StepReport, Sunk};
use super::settings::{Boundary, ContactBody, SolveSettings, UnstableMaterial};
use super::setup::Prepared;
use super::{diagnosis, setup};
use crate::mesh::MixedMesh;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};
use std::sync::Arc;

/// Contact points farther from a body than this do not limit the substep, mm.
const CONTACT_REACH_MM: f64 = 10.0;
/// Smaller motions of a segment along an axis in which its nodes are held are rounding, mm.
const HELD_TOLERANCE_MM: f64 = 1e-9;

/// Static equilibrium of one mesh under moving bone, advanced along a path.
#[derive(Debug)]
pub struct Solver<'a> {
    mesh: &'a MixedMesh,
    surface: Option<Arc<C1Surface>>,
    settings: SolveSettings,
    pub(super) equations: Equations<'a>,
    unguarded: Unguarded,
    /// Segments whose reactions are reported, ascending.
    segments: Vec<u32>,
    pub(super) state: State,
    /// Length of the last substep that converged.
    pub(super) substep: f64,
    /// Whether stable materials have replaced those requested.
    pub(super) stabilised: bool,
    /// Whether a warning has been given of tissue that passed through bone, and of tissue that slipped round a rim.
    pub(super) told_passage: [bool; 2],
    /// Warnings collected so far; the next report includes them.
    warnings: Vec<String>,
    /// Times and factorisations of the preparation, when this is the first solver over it; the first report includes them.
    preparation: (PhaseTimes, usize),
}

/// When bone moves no farther than this in a substep, mm, and tissue still passes through, the bone is too thin to hold it. When
/// it moves farther, the substep is shortened.
const LEAST_PASSAGE_MM: f64 = 0.25;

/// Largest number of times that a substep is solved again without contact at points that would pass to the other side of bone.
const MAX_RELEASES: usize = 6;

/// Wasted iterations, and shortened substeps, after which a step fails. A step that advances so slowly seldom converges, and the
/// reason helps the caller more than waiting.
const MAX_IN_VAIN: usize = 90;
const MAX_HALVINGS: usize = 24;

/// Volume ratio below which an element is reported: soft tissue is nearly incompressible.
const SQUEEZED: f64 = 0.3;

/// An equilibrium at path parameter `t`.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) t: f64,
    /// Values of the generalised nodes, mm.
    pub(super) x: Vec<Vector>,
    /// Motion of the moving segments from rest.
    pub(super) motions: Vec<(u32, Motion)>,
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
        let prepared = Prepared::new(mesh, !bodies.is_empty(), boundary, settings, &control.stage(0.0, 0.9))?;
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
        let unguarded = prepared.unguarded(mesh, equations.contact.bodies());
        equations.times.setup_s = (control.clock())() - begin;
        let state = State { t: 0.0, x: equations.dofs.rest().to_vec(), motions: Vec::new() };
        control.report(1.0);
        Ok(Self {
            mesh,
            surface: prepared.surface.clone(),
            settings: prepared.settings.clone(),
            equations,
            unguarded,
            segments,
            state,
            substep: f64::INFINITY,
            stabilised: false,
            told_passage: [false; 2],
            warnings,
            preparation: prepared.untold_work(),
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
        self.equations.records.clear();
        let from = self.state.t;
        let factorisations = self.equations.solver.factorisations();
        let mut report = Progress::default();
        let found = loop {
            control.check()?;
            let remaining = t - self.state.t;
            let wanted = remaining.abs().min(self.substep);
            let length = self.limit_contact_motion(wanted, remaining.signum(), motions);
            let goal =
                if length >= remaining.abs() * (1.0 - 1e-9) { t } else { self.state.t + length * remaining.signum() };
            let before = self.equations.records.len();
            match self.substep_to(goal, motions, control) {
                Ok(found) => {
                    report.substeps += 1;
                    report.iterations += found.iterations;
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
                    report.halvings += 1;
                    report.in_vain += self.equations.records.len() - before;
                    self.substep = 0.5 * length;
                    let is_spent = report.in_vain > MAX_IN_VAIN || report.halvings > MAX_HALVINGS;
                    if self.substep < self.settings.min_substep || length == 0.0 || is_spent {
                        if self.stabilise(goal) {
                            self.substep = length;
                            continue;
                        }
                        return Err(diagnosis::name(&self.equations, self.mesh, failure, goal, &self.state.x));
                    }
                }
            }
        };
        Ok(self.report(&found, &report, self.equations.solver.factorisations() - factorisations))
    }

    /// [`Solver::advance`] to a tolerance that suffices for display, not for measurement.
    ///
    /// The active set has converged, the residual is within 1e-2 of the reactions, and the estimated remaining displacement is at
    /// most 5e-3 of the element size (0.02 mm for 4 mm). Use [`Solver::advance`] for a step on which something is measured.
    ///
    /// # Errors
    /// As [`Solver::advance`].
    pub fn approach(
        &mut self,
        t: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
        control: &Control,
    ) -> Result<StepReport, SolveError> {
        self.equations.rough = true;
        let found = self.advance(t, motions, control);
        self.equations.rough = false;
        found
    }

    /// Drops warnings and times that another solver has already reported.
    pub(super) fn forget_untold(&mut self) {
        self.warnings.clear();
        self.preparation = Default::default();
    }

    /// Current positions of the mesh nodes, LPS mm, in the order of the mesh.
    #[must_use]
    pub fn positions(&self) -> Vec<Point> {
        self.state.x[..self.mesh.positions.len()].iter().map(|x| Point::from(*x)).collect()
    }

    /// Number of unknowns.
    #[must_use]
    pub fn n_unknowns(&self) -> usize {
        self.equations.dofs.n_scalar()
    }

    /// Path parameter of the current state.
    #[must_use]
    pub fn path_parameter(&self) -> f64 {
        self.state.t
    }

    /// Displacement (mm) of the point of the outer surface at barycentric `l` of prism `prism`.
    ///
    /// It is interpolated with the skin element's own shape functions; zero when there is no such prism.
    #[must_use]
    pub fn outer_displacement(&self, prism: u32, l: [f64; 3]) -> Vector {
        let prism = prism as usize;
        let Some(corners) = self.mesh.prisms.get(prism) else { return Vector::zeros() };
        let moved = |node: u32| self.state.x[node as usize] - self.equations.dofs.rest()[node as usize];
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
        super::cell_states::cell_states(&self.equations.assembly, self.mesh, &self.state.x)
    }

    /// Newton iterations of the last call of [`Solver::advance`].
    #[must_use]
    pub fn iterations(&self) -> &[IterationRecord] {
        &self.equations.records
    }

    fn substep_to(
        &mut self,
        goal: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
        control: &Control,
    ) -> Result<Equilibrium, Failure> {
        let listed = motions(goal);
        let body_motions = self.body_motions(&listed);
        self.equations.load_share = goal;
        let from = self.state.t;
        let bodies: Vec<u32> = self.equations.contact.bodies().iter().map(|b| b.segment).collect();
        let on_the_way = |share: f64| -> Vec<Motion> {
            let listed = motions(if share == 1.0 { goal } else { from + share * (goal - from) });
            bodies.iter().map(|b| motion_of(&listed, *b)).collect()
        };
        let before = self.body_motions(&self.state.motions);
        let length_mm = self.contact_motion(&body_motions);
        let multipliers = self.equations.contact.multipliers().to_vec();
        let released = self.equations.contact.released().to_vec();
        let mut rounds = 0;
        let attempt = loop {
            let attempt = self
                .equations
                .predict(&self.state.x, &on_the_way, length_mm, &|segment| motion_of(&listed, segment))
                .and_then(|mut x| {
                    let found = self.equations.equilibrate(&mut x, &body_motions, goal, control)?;
                    Ok((x, found))
                });
            let Ok((x, _)) = &attempt else { break attempt };
            let passages = self.equations.contact.passages((&self.state.x, x), (&before, &body_motions));
            let moved = |place: &Point, (from, to): (&Motion, &Motion)| {
                (to.transform_point(&from.inverse_transform_point(place)) - place).norm()
            };
            let moved_mm =
                |p: &Passage| before.iter().zip(&body_motions).map(|m| moved(&p.place, m)).fold(0.0, f64::max);
            if let Some(p) = passages.iter().find(|p| !p.round_a_rim && moved_mm(p) > LEAST_PASSAGE_MM) {
                break Err(Failure::PassedThrough { body: p.body, place: p.place });
            }
            rounds += 1;
            if passages.is_empty() || rounds > MAX_RELEASES {
                break attempt;
            }
            // A body that would push these points the wrong way does not act on them from the start of the substep on.
            self.equations.contact.set_multipliers(multipliers.clone());
            passages.iter().for_each(|p| self.equations.contact.release(p));
            self.tell_passages(&passages);
        };
        match attempt {
            Ok((x, found)) => {
                self.state = State { t: goal, x, motions: listed };
                Ok(found)
            }
            Err(failure) => {
                self.equations.contact.set_multipliers(multipliers);
                self.equations.contact.set_released(released);
                Err(failure)
            }
        }
    }

    /// Warns of the first passage of each kind.
    fn tell_passages(&mut self, passages: &[Passage]) {
        for round_a_rim in [false, true] {
            let of_kind: Vec<&Passage> = passages.iter().filter(|p| p.round_a_rim == round_a_rim).collect();
            let Some(Passage { body, place, .. }) = of_kind.first() else { continue };
            if std::mem::replace(&mut self.told_passage[usize::from(round_a_rim)], true) {
                continue;
            }
            let segment = self.equations.contact.bodies()[*body].segment;
            let how = if round_a_rim { "slips round a rim of" } else { "passes through thin parts of" };
            self.warnings.push(format!(
                "tissue near ({:.1}, {:.1}, {:.1}) mm {how} bone {segment}: from there on this bone does not act on the \
                 affected points, so the result near them is unreliable",
                place.x, place.y, place.z
            ));
        }
    }

    /// Replaces materials that have lost ellipticity on the path to `goal` by stable ones, if the settings request it. Returns
    /// whether it did.
    fn stabilise(&mut self, goal: f64) -> bool {
        if self.stabilised || self.settings.unstable_material == UnstableMaterial::Report {
            return false;
        }
        let x = self.equations.last_iterate().unwrap_or(&self.state.x);
        let Some(lost) = diagnosis::lost_ellipticity(&self.equations, self.mesh, x) else { return false };
        if !self.equations.stabilise() {
            return false;
        }
        self.stabilised = true;
        self.warnings.push(format!(
            "at {goal:.4} of the path {lost}: from there on neo-Hookean with the same moduli replaces every material that can \
             lose it, as asked for"
        ));
        true
    }

    fn body_motions(&self, listed: &[(u32, Motion)]) -> Vec<Motion> {
        self.equations.contact.bodies().iter().map(|b| motion_of(listed, b.segment)).collect()
    }

    /// Shortens a substep until bone near contact points moves at most [`MAX_CONTACT_MOTION_MM`], but not below the shortest one
    /// allowed.
    fn limit_contact_motion(&self, wanted: f64, sign: f64, motions: &dyn Fn(f64) -> Vec<(u32, Motion)>) -> f64 {
        if self.equations.contact.is_empty() {
            return wanted;
        }
        let mut length = wanted;
        loop {
            let moved = self.contact_motion(&self.body_motions(&motions(self.state.t + sign * length)));
            // The 1 % margin keeps a step of twice the limit from being cut in three.
            if moved <= 1.01 * MAX_CONTACT_MOTION_MM || length <= self.settings.min_substep {
                return length;
            }
            length = (wanted / (wanted / length * moved / MAX_CONTACT_MOTION_MM).ceil()).max(self.settings.min_substep);
        }
    }

    /// Largest displacement of bone near contact points from the current state on, mm.
    fn contact_motion(&self, to: &[Motion]) -> f64 {
        let from = self.body_motions(&self.state.motions);
        self.equations.contact.largest_motion(&self.state.x, &from, to, CONTACT_REACH_MM)
    }

    fn report(&mut self, found: &Equilibrium, progress: &Progress, factorisations: usize) -> StepReport {
        let mut warnings = std::mem::take(&mut self.warnings);
        let (mut phases, prepared) = std::mem::take(&mut self.preparation);
        phases += self.equations.take_times();
        if progress.halvings > 0 {
            warnings.push(format!(
                "substeps were shortened {} times so that Newton's method could converge",
                progress.halvings
            ));
        }
        let dets: Vec<f64> = self.equations.assembly.min_det(&self.state.x).into_iter().flatten().collect();
        let min_det_f = dets.iter().copied().fold(f64::INFINITY, f64::min);
        let inside_out = dets.iter().filter(|det| **det <= 0.0).count();
        if self.settings.model.is_linear() {
            warnings.extend(diagnosis::left_out_strain(&self.equations, &self.state.x));
        }
        let squeezed = dets.iter().filter(|det| **det > 0.0 && **det < SQUEEZED).count();
        if squeezed > 0 {
            warnings.push(format!(
                "{squeezed} elements are compressed below {SQUEEZED} of their volume, the smallest to {:.3}: check whether \
                 tissue folds there, or use more steps or a finer mesh",
                dets.iter().copied().filter(|det| *det > 0.0).fold(f64::INFINITY, f64::min)
            ));
        }
        let torn = self.equations.dofs.contradictions(|s| motion_of(&self.state.motions, s), HELD_TOLERANCE_MM);
        if torn > 0 {
            warnings.push(format!(
                "{torn} tied nodes are also held along an axis in which their segment moves; they stay at rest along it"
            ));
        }
        let askew = self.equations.dofs.askew_tangents();
        if askew > 0 {
            warnings.push(format!(
                "{askew} tangents of C1 prisms at nodes held along an axis are oblique to it and stay free: there the surface \
                 need not meet the plane of symmetry at a right angle"
            ));
        }
        let lost = diagnosis::lost_ellipticity(&self.equations, self.mesh, &self.state.x);
        let outcome = match lost {
            Some(lost) => StepOutcome::OutsideEllipticity(lost),
            None if inside_out > 0 => StepOutcome::InsideOut { elements: inside_out, min_det_f },
            None if self.stabilised => StepOutcome::Stabilised,
            None => StepOutcome::Converged,
        };
        warnings.extend(outcome.fault().map(|fault| format!("{fault}: the result of this step is unreliable")));
        let body_motions = self.body_motions(&self.state.motions);
        let free = self.unguarded.deepest(&self.state.x, self.equations.contact.bodies(), &body_motions);
        let sunk = deeper(free, self.equations.contact.sunk(&self.state.x, &body_motions));
        let reactions_n = self.equations.reactions(&self.state.x, &body_motions, &self.segments);
        StepReport {
            outcome,
            newton_iterations: progress.iterations,
            substeps: progress.substeps,
            factorisations: factorisations + prepared,
            relative_residual: found.relative_residual,
            remaining_mm: found.remaining_mm,
            min_det_f,
            max_penetration_mm: super::contact::penetration(&found.touches),
            sunk,
            active_contacts: found.touches.len(),
            reactions_n,
            unknowns: self.equations.dofs.n_scalar(),
            phases,
            warnings,
        }
    }
}

/// Counts of one call of [`Solver::advance`].
#[derive(Debug, Default)]
struct Progress {
    substeps: usize,
    iterations: usize,
    halvings: usize,
    /// Iterations of substeps that did not converge.
    in_vain: usize,
}

/// The deeper of two, with the sum of their point counts.
fn deeper(a: Option<Sunk>, b: Option<Sunk>) -> Option<Sunk> {
    match (a, b) {
        (Some(a), Some(b)) => {
            let points = a.points + b.points;
            Some(Sunk { points, ..if b.depth_mm > a.depth_mm { b } else { a } })
        }
        (one, other) => one.or(other),
    }
}

fn motion_of(listed: &[(u32, Motion)], segment: u32) -> Motion {
    listed.iter().find(|(s, _)| *s == segment).map_or_else(Motion::identity, |(_, m)| *m)
}
