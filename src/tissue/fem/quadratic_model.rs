//! The quadratic model of the energy with unilateral contact: the Newton step and the linear prediction of a load step.

use super::tuning::{MAX_CONTACT_MOTION_MM, DOUBTFUL_MM, FORCING_OF_PREDICTION, MAX_ACTIVE_SETS, NEGLIGIBLE_CHANGES, TRUSTED_MM};
use super::assembly::Curvature;
use super::condensed::StepPath;
use super::contact::{Curved, ContactPair};
use super::equations::Equations;
use super::factor::Indefinite;
use super::dot::dot;
use super::linear_solve::System;
use super::failure::Failure;
use super::report::IterationRecord;
use prosopon_geometry::{Motion, Vector};

/// Share of the bodies' curvature that a model includes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Bend {
    /// Share at a state that does not come from the condensed contact solve.
    pub(super) share: f64,
    /// Whether the whole curvature is included at a state from the condensed contact solve.
    pub(super) settled: bool,
    /// Whether the last model included any.
    pub(super) used: bool,
}

impl Equations<'_> {
    /// Computes `self.values` from the stiffness of the elements and of `touches`.
    pub(super) fn add_contact(&mut self, touches: &[ContactPair], curved: Option<Curved<'_>>) {
        self.values.copy_from_slice(&self.elastic);
        let (pattern, values) = (self.assembly.pattern(), &mut self.values);
        self.contact.hessian(touches, curved, &self.dofs, |row, column, block| pattern.add(row, column, block, values));
        pattern.hold(self.dofs.partly_held(), values);
    }

    /// Minimises the quadratic model of the energy over the unknowns.
    ///
    /// The elements have gradient `load` (by all nodes) and stiffness `self.elastic` at `x`. Contact is linearised at the state
    /// of the condensed contact solve, or else at `x`. A primal-dual active set decides which points are active in the model's
    /// own solution: otherwise a step would run into bone that was not active at its start.
    pub(super) fn minimise_model(
        &mut self,
        x: &[Vector],
        motions: &[Motion],
        load: &[Vector],
        bend: &mut Bend,
        forcing: f64,
        record: &mut IterationRecord,
    ) -> Result<Vec<f64>, Indefinite> {
        let n = self.residual.len();
        let (mut d, mut change, mut rhs) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        self.prepare();
        self.dofs.restrict(load, &mut rhs);
        let settles = self.settles && !self.contact.is_empty();
        let settled = if settles { self.solve_condensed(x, motions, &rhs) } else { None };
        let (near, mut active, mut curved): (Vec<ContactPair>, Vec<ContactPair>, _) = match &settled {
            Some(settled) => {
                d.copy_from_slice(&settled.d);
                let bent = (settled.curved && bend.settled).then_some(Curved { x: &settled.x, motions, share: 1.0 });
                (settled.near.clone(), settled.active.clone(), bent)
            }
            None => {
                let near = self.near(x, motions);
                // The last active set is closer to the solution than the contacts found after a whole step of the bone.
                let active = near.iter().filter(|t| self.active.binary_search(&t.pair()).is_ok()).copied().collect();
                let bent = (bend.share > 0.0).then_some(Curved { x, motions, share: bend.share });
                (near, active, bent)
            }
        };
        bend.used = curved.is_some();
        let few = if self.limits.linear { 0 } else { active.len() / NEGLIGIBLE_CHANGES };
        for round in 0..MAX_ACTIVE_SETS {
            let begin = (self.clock)();
            self.add_contact(&active, curved);
            let mut gradient = load.to_vec();
            self.contact.add_forces(&active, &mut gradient);
            self.dofs.restrict(&gradient, &mut rhs);
            // Square of the solution's energy norm, estimated with the factor.
            let norm_sq = settled.as_ref().map(|s| -dot(&rhs, &s.d)).filter(|norm| *norm > 0.0);
            if let Some(settled) = &settled {
                self.assembly.pattern().multiply(&self.elastic, &settled.d, &mut change);
                rhs.iter_mut().zip(&change).for_each(|(r, c)| *r += c);
            }
            if round > 0 {
                let from = settled.as_ref().map_or(&[][..], |s| &s.d).iter().copied().chain(std::iter::repeat(0.0));
                let farther: Vec<f64> = d.iter().zip(from).map(|(d, from)| d - from).collect();
                self.assembly.pattern().multiply(&self.values, &farther, &mut change);
                rhs.iter_mut().zip(&change).for_each(|(r, c)| *r += c);
            }
            rhs.iter_mut().for_each(|r| *r = -*r);
            self.times.contact_s += (self.clock)() - begin;
            let tolerance = self.solver.tolerance(forcing);
            let terms = self.contact.terms(&active, &self.dofs);
            if settled.is_some() && curved.is_some() {
                let change = self.solver.estimate(&terms, &rhs);
                if self.dofs.max_position_change(&change) > DOUBTFUL_MM {
                    (curved, bend.used) = (None, false);
                    continue;
                }
            }
            let system = System { values: &self.values, elastic: &self.elastic, contact: &terms };
            let before = self.solver.factorisations();
            let work = self.solver.solve(self.assembly.pattern(), system, &rhs, &mut change, tolerance, norm_sq);
            self.note_factor(before);
            let work = work?;
            record.factorised |= work.factorised;
            record.cg_iterations += work.cg_iterations;
            if settled.is_some() && curved.is_some() && self.dofs.max_position_change(&change) > TRUSTED_MM {
                // Where the tangent with curvature is nearly singular, points would slide beyond the validity of the model.
                (curved, bend.used) = (None, false);
                continue;
            }
            d.iter_mut().zip(&change).for_each(|(d, c)| *d += c);
            let next: Vec<ContactPair> =
                near.iter().filter(|t| self.contact.pressure_after(t, &self.dofs, &d) > 0.0).copied().collect();
            let changes = differing(&next, &active);
            active = next;
            if changes <= few {
                break;
            }
        }
        self.active = active.iter().map(ContactPair::pair).collect();
        Ok(d)
    }

    /// Linear prediction of the state after the bones have moved: held nodes take their prescribed positions, the others follow
    /// by the tangent at `x`. `motions` gives the motions of the bodies at a share of the path, along which bone near contact
    /// points moves by `length_mm`.
    pub(super) fn predict(
        &mut self,
        x: &[Vector],
        motions: &dyn Fn(f64) -> Vec<Motion>,
        length_mm: f64,
        motion_of: &dyn Fn(u32) -> Motion,
    ) -> Result<Vec<Vector>, Failure> {
        self.failed_at.clear();
        self.settles = true;
        let mut target = x.to_vec();
        self.dofs.prescribe(motion_of, self.load_share, &mut target);
        let change: Vec<Vector> = target.iter().zip(x).map(|(a, b)| a - b).collect();
        let mut load = vec![Vector::zeros(); x.len()];
        self.assembly.force_change(x, &change, &mut load)?;
        self.assembly.forces(x, &mut self.forces)?;
        let mut forces = self.forces.clone();
        load.iter_mut().zip(&self.forces).for_each(|(load, f)| *load += f);
        self.subtract_loads(&mut load);
        self.subtract_loads(&mut forces);
        let gradients = [&forces, &load].map(|by_node| {
            let mut gradient = vec![0.0; self.residual.len()];
            self.dofs.restrict(by_node, &mut gradient);
            gradient
        });
        let kept = self.contact_forces.clone();
        let all_the_way = &motions(1.0);
        for curvature in [Curvature::Exact, Curvature::Projected] {
            self.tangent(x, curvature)?;
            let mut record = IterationRecord::default();
            self.prepare();
            let way = StepPath { length_mm, x: [x, &target], gradients: [&gradients[0], &gradients[1]], motions };
            if self.track_contact(&way).is_none() {
                self.contact_forces.clone_from(&kept);
            }
            let motions = all_the_way;
            if let Ok(d) = self.minimise_model(&target, motions, &load, &mut Bend::default(), FORCING_OF_PREDICTION, &mut record) {
                self.dofs.add(1.0, &d, &mut target);
                let (_, found_mm) = self.energy(&target, motions)?;
                if found_mm > 2.0 * MAX_CONTACT_MOTION_MM {
                    return Err(Failure::Penetration { found_mm });
                }
                return Ok(target);
            }
            self.solver.refresh();
        }
        Err(Failure::Indefinite)
    }
}

/// Number of points in exactly one of two sets, each in the order of points.
fn differing(a: &[ContactPair], b: &[ContactPair]) -> usize {
    let common = a.iter().filter(|t| b.binary_search_by_key(&t.pair(), ContactPair::pair).is_ok()).count();
    a.len() + b.len() - 2 * common
}
