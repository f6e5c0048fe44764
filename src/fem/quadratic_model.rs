//! The quadratic model of the energy with unilateral contact: Newton's direction and the linear prediction of a step.

use super::assembly::Curvature;
use super::contact::{Curved, Touch};
use super::factor::Indefinite;
use super::linear_solve::System;
use super::newton::{Equations, Failure, MAX_CONTACT_MOTION_MM};
use super::report::IterationRecord;
use crate::geometry::{Motion, Vector};

/// Changes of the set of touching points are left to the next iteration when they are fewer than one point in so many.
const NEGLIGIBLE: usize = 50;
/// Changes of the set of touching points within one Newton step.
const MAX_ACTIVE_SETS: usize = 8;

impl Equations<'_> {
    /// `self.values` from the elements' stiffness and that of `touches`.
    pub(super) fn add_contact(&mut self, touches: &[Touch], curved: Option<Curved<'_>>) {
        self.values.copy_from_slice(&self.elastic);
        let (pattern, values) = (self.assembly.pattern(), &mut self.values);
        self.contact.hessian(touches, curved, &self.dofs, |row, column, block| pattern.add(row, column, block, values));
        pattern.hold(self.dofs.partly_held(), values);
    }

    /// Minimises the quadratic model of the energy over the unknowns: elements with gradient `load` (by all nodes) and stiffness
    /// `self.elastic`, and the points `near`, each of which pushes or not as the model's own solution says (a primal-dual
    /// active set: without it a step runs into bone that it did not know of).
    pub(super) fn minimise_model(
        &mut self,
        load: &[Vector],
        near: &[Touch],
        curved: Option<Curved<'_>>,
        forcing: f64,
        record: &mut IterationRecord,
    ) -> Result<Vec<f64>, Indefinite> {
        let n = self.residual.len();
        let (mut d, mut change, mut rhs) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        // What the last model found is nearer to its answer than what touches after a whole step of the bone.
        let mut active: Vec<Touch> =
            near.iter().filter(|t| self.active.binary_search(&t.pair()).is_ok()).copied().collect();
        if !near.is_empty() {
            self.solver.prepare(self.assembly.pattern(), &self.elastic);
            let begin = (self.clock)();
            let terms = self.contact.terms(near, &self.dofs);
            let loads = self.contact.loads(near);
            let first = (0..near.len()).filter(|&i| self.active.binary_search(&near[i].pair()).is_ok()).collect();
            self.dofs.restrict(load, &mut rhs);
            let (contact, dofs) = (&self.contact, &self.dofs);
            let pushes = |d: &[f64], i: usize| contact.pressure_after(&near[i], dofs, d) > 0.0;
            self.times.contact_s += (self.clock)() - begin;
            let found = self.solver.guess_active(&rhs, &terms, &loads, &pushes, first);
            active = found.into_iter().map(|i| near[i]).collect();
        }
        let few = if self.limits.linear { 0 } else { active.len() / NEGLIGIBLE };
        for round in 0..MAX_ACTIVE_SETS {
            let begin = (self.clock)();
            self.add_contact(&active, curved);
            let mut gradient = load.to_vec();
            self.contact.add_forces(&active, &mut gradient);
            self.dofs.restrict(&gradient, &mut rhs);
            if round > 0 {
                self.assembly.pattern().multiply(&self.values, &d, &mut change);
                rhs.iter_mut().zip(&change).for_each(|(r, c)| *r += c);
            }
            rhs.iter_mut().for_each(|r| *r = -*r);
            self.times.contact_s += (self.clock)() - begin;
            let tolerance = self.solver.tolerance(forcing);
            let terms = self.contact.terms(&active, &self.dofs);
            let system = System { values: &self.values, elastic: &self.elastic, contact: &terms };
            let work = self.solver.solve(self.assembly.pattern(), system, &rhs, &mut change, tolerance)?;
            record.factorised |= work.factorised;
            record.cg_iterations += work.cg_iterations;
            d.iter_mut().zip(&change).for_each(|(d, c)| *d += c);
            let next: Vec<Touch> =
                near.iter().filter(|t| self.contact.pressure_after(t, &self.dofs, &d) > 0.0).copied().collect();
            let changes = differing(&next, &active);
            active = next;
            if changes <= few {
                break;
            }
        }
        self.active = active.iter().map(Touch::pair).collect();
        Ok(d)
    }

    /// Linear estimate of the state after the bones have moved to `motions`: held nodes go where they must, the others
    /// follow by the tangent at `x`.
    pub(super) fn predict(
        &mut self,
        x: &[Vector],
        motions: &[Motion],
        motion_of: &dyn Fn(u32) -> Motion,
    ) -> Result<Vec<Vector>, Failure> {
        self.failed_at.clear();
        let mut target = x.to_vec();
        self.dofs.prescribe(motion_of, &mut target);
        let change: Vec<Vector> = target.iter().zip(x).map(|(a, b)| a - b).collect();
        let mut load = vec![Vector::zeros(); x.len()];
        self.assembly.force_change(x, &change, &mut load)?;
        self.assembly.forces(x, &mut self.forces)?;
        load.iter_mut().zip(&self.forces).for_each(|(load, f)| *load += f);
        self.subtract_loads(&mut load);
        let near = self.near(&target, motions);
        for curvature in [Curvature::Exact, Curvature::Projected] {
            self.tangent(x, curvature)?;
            if let Ok(d) = self.minimise_model(&load, &near, None, 1e-2, &mut IterationRecord::default()) {
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

/// Number of points that are in one of two sets, each in the order of points.
fn differing(a: &[Touch], b: &[Touch]) -> usize {
    let common = a.iter().filter(|t| b.binary_search_by_key(&t.pair(), Touch::pair).is_ok()).count();
    a.len() + b.len() - 2 * common
}
