//! The report of one step.

use super::contact::penetration;
use super::diagnosis;
use super::newton::Equilibrium;
use super::report::{BonePenetration, StepOutcome, StepReport};
use super::solver::{Progress, Solver};
use super::substep::motion_of;
use super::tuning::{FEW_HALVINGS, HELD_TOLERANCE_MM, SQUEEZED};
use prosopon_geometry::Warning;

impl Solver<'_> {
    /// Report of a step that ended in the equilibrium `found`.
    pub(super) fn report(&mut self, found: &Equilibrium, progress: &Progress, factorisations: usize) -> StepReport {
        let mut warnings = std::mem::take(&mut self.warnings);
        let preparation = std::mem::take(&mut self.preparation);
        let mut phases = preparation.times;
        phases += self.equations.work.take_times();
        let dets: Vec<f64> = self.equations.problem.assembly().min_det(&self.reached.x).into_iter().flatten().collect();
        let min_det_f = dets.iter().copied().fold(f64::INFINITY, f64::min);
        let inside_out = dets.iter().filter(|det| **det <= 0.0).count();
        warnings.extend(halvings_warning(progress.halvings));
        if self.settings.model.is_linear() {
            warnings.extend(diagnosis::left_out_strain(&self.equations, &self.reached.x));
        }
        warnings.extend(squeezed_warning(&dets));
        warnings.extend(self.condition_warnings());
        let lost = diagnosis::lost_ellipticity(&self.equations, self.mesh, &self.reached.x);
        let outcome = match lost {
            Some(lost) => StepOutcome::OutsideEllipticity(lost),
            None if inside_out > 0 => StepOutcome::InsideOut { elements: inside_out, min_det_f },
            None if self.stabilised => StepOutcome::Stabilised,
            None => StepOutcome::Converged,
        };
        warnings.extend(outcome.warning());
        let body_motions = self.body_motions(&self.reached.motions);
        let free = self.noncontact.deepest(&self.reached.x, self.equations.state.contact.bodies(), &body_motions);
        let bone_penetration =
            deeper(free, self.equations.state.contact.bone_penetration(&self.reached.x, &body_motions));
        let reactions_n = self.equations.reactions(&self.reached.x, &body_motions, &self.segments);
        StepReport {
            outcome,
            newton_iterations: progress.iterations,
            substeps: progress.substeps,
            factorisations: factorisations + preparation.factorisations,
            relative_residual: found.relative_residual,
            remaining_mm: found.remaining_mm,
            min_det_f,
            max_penetration_mm: penetration(&found.contacts),
            gliding_gap_mm: self.equations.state.springs.largest_gap_mm(&self.reached.x, &body_motions),
            pulled_off: self.equations.state.springs.pulled_off(),
            bone_penetration,
            active_contacts: found.contacts.len(),
            reactions_n,
            unknowns: self.equations.problem.dofs().n_scalar(),
            phases,
            warnings,
        }
    }

    /// Warnings about conditions that contradict each other.
    fn condition_warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let dofs = self.equations.problem.dofs();
        let torn = dofs.contradictions(|s| motion_of(&self.reached.motions, s), HELD_TOLERANCE_MM);
        if torn > 0 {
            let message = format!(
                "{torn} tied nodes are also held along an axis in which their segment moves; they stay at rest along it"
            );
            warnings
                .push(Warning::check("held-tied-nodes", message).act("Do not hold nodes that are tied to a segment."));
        }
        let oblique = dofs.oblique_tangents();
        if oblique > 0 {
            let message = format!(
                "{oblique} tangents of C1 prisms at nodes held along an axis are oblique to it and stay free: there the surface \
                 need not meet the plane of symmetry at a right angle"
            );
            warnings.push(Warning::check("oblique-tangents", message));
        }
        warnings
    }
}

/// Warning about substeps that were shortened.
fn halvings_warning(halvings: usize) -> Option<Warning> {
    let message = || format!("substeps were shortened {halvings} times so that Newton's method could converge");
    match halvings {
        0 => None,
        1..=FEW_HALVINGS => Some(Warning::info("shortened-substeps", message())),
        _ => Some(Warning::check("shortened-substeps", message()).act("Use more steps.")),
    }
}

/// Warning about elements whose smallest det F in `dets` shows strong compression.
fn squeezed_warning(dets: &[f64]) -> Option<Warning> {
    let squeezed = dets.iter().filter(|det| **det > 0.0 && **det < SQUEEZED).count();
    (squeezed > 0).then(|| {
        let message = format!(
            "{squeezed} elements are compressed below {SQUEEZED} of their volume, the smallest to {:.3}",
            dets.iter().copied().filter(|det| *det > 0.0).fold(f64::INFINITY, f64::min)
        );
        Warning::check("squeezed-elements", message)
            .act("Check whether tissue folds there, or use more steps or a finer mesh.")
    })
}

/// The deeper of two, with the sum of their point counts.
fn deeper(a: Option<BonePenetration>, b: Option<BonePenetration>) -> Option<BonePenetration> {
    match (a, b) {
        (Some(a), Some(b)) => {
            let points = a.points + b.points;
            Some(BonePenetration { points, ..if b.depth_mm > a.depth_mm { b } else { a } })
        }
        (one, other) => one.or(other),
    }
}
