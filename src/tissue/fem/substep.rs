//! One substep of a path: prediction, equilibrium, and the treatment of points that pass to the other side of bone.

use super::contact::{Passage, Placement};
use super::diagnosis;
use super::failure::Failure;
use super::newton::{Equilibrium, Target, equilibrate};
use super::quadratic_model::predict;
use super::settings::UnstableMaterial;
use super::solver::Solver;
use super::state::PathPoint;
use super::tuning::{
    CONTACT_MOTION_MARGIN, CONTACT_REACH_MM, MAX_CONTACT_MOTION_MM, MAX_FACING_MOTION_MM, MAX_RELEASES,
    PASSAGE_MOTION_MM,
};
use prosopon_geometry::{Motion, Point, Vector, Warning};

impl Solver<'_> {
    /// Solves the substep to `goal`. On failure state and contact are those before.
    pub(super) fn substep_to(
        &mut self,
        goal: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
    ) -> Result<Equilibrium, Failure> {
        let listed = motions(goal);
        let body_motions = self.body_motions(&listed);
        self.equations.state.load_share = goal;
        let from = self.reached.t;
        let bodies: Vec<u32> = self.equations.state.contact.bodies().iter().map(|b| b.segment).collect();
        let along_path = |share: f64| -> Vec<Motion> {
            let listed = motions(if share == 1.0 { goal } else { from + share * (goal - from) });
            bodies.iter().map(|b| motion_of(&listed, *b)).collect()
        };
        let before = self.body_motions(&self.reached.motions);
        let length_mm = self.contact_motion(&body_motions);
        let multipliers = self.equations.state.contact.multipliers().to_vec();
        let released = self.equations.state.contact.released().to_vec();
        let springs = self.equations.state.springs.memory().clone();
        let target = Target { t: goal, motions: &body_motions };
        let mut rounds = 0;
        let attempt = loop {
            let motion_of = |segment| motion_of(&listed, segment);
            let attempt = self.attempt(target, &along_path, length_mm, &motion_of);
            let Ok((x, _)) = &attempt else { break attempt };
            if let Some(found_mm) = self.equations.state.contact.facing_passage(&self.reached.x, x) {
                break Err(Failure::Penetration { found_mm });
            }
            let passages = self.passages(x, &before, &body_motions);
            // Those found are not all when the search was cancelled.
            if self.equations.state.control.is_cancelled() {
                break Err(Failure::Cancelled);
            }
            if let Some(p) =
                passages.iter().find(|p| !p.round_a_rim && moved_mm(p, &before, &body_motions) > PASSAGE_MOTION_MM)
            {
                break Err(Failure::PassedThrough { body: p.body, place: p.place });
            }
            rounds += 1;
            if passages.is_empty() || rounds > MAX_RELEASES {
                break attempt;
            }
            // A body that would push these points the wrong way does not act on them from the start of the substep on.
            self.equations.state.contact.set_multipliers(multipliers.clone());
            self.equations.state.springs.set_memory(springs.clone());
            passages.iter().for_each(|p| self.equations.state.contact.release(p));
            self.warn_of_passages(&passages);
        };
        match attempt {
            Ok((x, found)) => {
                self.reached = PathPoint { t: goal, x, motions: listed };
                Ok(found)
            }
            Err(failure) => {
                self.equations.state.contact.set_multipliers(multipliers);
                self.equations.state.contact.set_released(released);
                self.equations.state.springs.set_memory(springs);
                Err(failure)
            }
        }
    }

    /// Predicts the state at `target` and iterates it to equilibrium.
    fn attempt(
        &mut self,
        target: Target<'_>,
        along_path: &dyn Fn(f64) -> Vec<Motion>,
        length_mm: f64,
        motion_of: &dyn Fn(u32) -> Motion,
    ) -> Result<(Vec<Vector>, Equilibrium), Failure> {
        let mut x = predict(&mut self.equations, &self.reached.x, along_path, length_mm, motion_of)?;
        let found = equilibrate(&mut self.equations, &mut x, target)?;
        Ok((x, found))
    }

    /// Contact points that pass to the other side of a body on the way from the last equilibrium to `x`.
    fn passages(&self, x: &[Vector], before: &[Motion], after: &[Motion]) -> Vec<Passage> {
        let start = Placement { x: &self.reached.x, motions: before };
        self.equations.state.contact.passages(start, Placement { x, motions: after }, &self.equations.state.control)
    }

    /// Warns of the first passage of each kind.
    fn warn_of_passages(&mut self, passages: &[Passage]) {
        for round_a_rim in [false, true] {
            let of_kind: Vec<&Passage> = passages.iter().filter(|p| p.round_a_rim == round_a_rim).collect();
            let Some(Passage { body, place, .. }) = of_kind.first() else { continue };
            if std::mem::replace(&mut self.warned_passage[usize::from(round_a_rim)], true) {
                continue;
            }
            let segment = self.equations.state.contact.bodies()[*body].segment;
            let (code, how) = if round_a_rim {
                ("tissue-round-rim", "slips round a rim of")
            } else {
                ("tissue-through-bone", "passes through thin parts of")
            };
            let message = format!(
                "tissue near ({:.1}, {:.1}, {:.1}) mm {how} bone {segment}: from there on this bone does not act on the \
                 affected points, so the result near them may be wrong",
                place.x, place.y, place.z
            );
            self.warnings.push(Warning::unreliable(code, message).act("Use shorter steps, or check the bone there."));
        }
    }

    /// Replaces materials that have lost ellipticity on the path to `goal` by stable ones, if the settings request it. Returns
    /// whether it did.
    pub(super) fn stabilise(&mut self, goal: f64) -> bool {
        if self.stabilised || self.settings.unstable_material == UnstableMaterial::Report {
            return false;
        }
        let x = self.equations.state.last_iterate().unwrap_or(&self.reached.x);
        let Some(lost) = diagnosis::lost_ellipticity(&self.equations, self.mesh, x) else { return false };
        if !self.equations.stabilise() {
            return false;
        }
        self.stabilised = true;
        let message = format!(
            "at {goal:.4} of the path {lost}: from there on neo-Hookean with the same moduli replaces every material that can \
             lose it, as requested"
        );
        self.warnings.push(Warning::check("materials-replaced", message));
        true
    }

    pub(super) fn body_motions(&self, listed: &[(u32, Motion)]) -> Vec<Motion> {
        self.equations.state.contact.bodies().iter().map(|b| motion_of(listed, b.segment)).collect()
    }

    /// Shortens a substep until bone near contact points moves at most [`MAX_CONTACT_MOTION_MM`], but not below the shortest one
    /// allowed.
    pub(super) fn limit_contact_motion(
        &self,
        wanted: f64,
        sign: f64,
        motions: &dyn Fn(f64) -> Vec<(u32, Motion)>,
    ) -> f64 {
        if self.equations.state.contact.is_empty() {
            return wanted;
        }
        let mut length = wanted;
        loop {
            let listed = motions(self.reached.t + sign * length);
            let of_bodies = self.contact_motion(&self.body_motions(&listed));
            let moved = of_bodies.max(self.facing_motion(sign * length, &listed, motions));
            // The 1 % margin keeps a step of twice the limit from being cut in three.
            if moved <= CONTACT_MOTION_MARGIN * MAX_CONTACT_MOTION_MM || length <= self.settings.min_substep {
                return length;
            }
            length = (wanted / (wanted / length * moved / MAX_CONTACT_MOTION_MM).ceil()).max(self.settings.min_substep);
        }
    }

    /// Largest displacement of a held node when the path parameter grows by `length`, mm, in units in which the limit is
    /// [`MAX_CONTACT_MOTION_MM`]; 0 without facing tissue.
    fn facing_motion(&self, length: f64, listed: &[(u32, Motion)], motions: &dyn Fn(f64) -> Vec<(u32, Motion)>) -> f64 {
        if !self.equations.state.contact.has_facing() {
            return 0.0;
        }
        let (dofs, t) = (self.equations.problem.dofs(), self.reached.t);
        let [mut from, mut to] = [dofs.rest().to_vec(), dofs.rest().to_vec()];
        let now = motions(t);
        dofs.prescribe(|s| motion_of(&now, s), t, &mut from);
        dofs.prescribe(|s| motion_of(listed, s), t + length, &mut to);
        let nodes = from.iter().zip(&to).enumerate().filter(|(node, _)| dofs.is_position(*node));
        let moved = nodes.map(|(_, (a, b))| (b - a).norm()).fold(0.0, f64::max);
        moved * MAX_CONTACT_MOTION_MM / MAX_FACING_MOTION_MM
    }

    /// Largest displacement of bone near contact points from the current state on, mm.
    fn contact_motion(&self, to: &[Motion]) -> f64 {
        let from = self.body_motions(&self.reached.motions);
        self.equations.state.contact.largest_motion(&self.reached.x, &from, to, CONTACT_REACH_MM)
    }
}

/// Largest motion of a body at the place of a passage, mm.
fn moved_mm(passage: &Passage, before: &[Motion], after: &[Motion]) -> f64 {
    let moved = |place: &Point, (from, to): (&Motion, &Motion)| {
        (to.transform_point(&from.inverse_transform_point(place)) - place).norm()
    };
    before.iter().zip(after).map(|m| moved(&passage.place, m)).fold(0.0, f64::max)
}

/// Motion of `segment` from rest; segments that are not listed stay at rest.
pub(super) fn motion_of(listed: &[(u32, Motion)], segment: u32) -> Motion {
    listed.iter().find(|(s, _)| *s == segment).map_or_else(Motion::identity, |(_, m)| *m)
}
