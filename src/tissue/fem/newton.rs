//! Newton's method on the total potential energy at fixed positions of the bones.

use super::tuning::{COARSE_DISPLACEMENT, COARSE_RESIDUAL, CONDENSED_ITERATIONS, CONDENSED_MAX_RATIO, DISPLACEMENT_TOLERANCE, DISPLAY_STEP_MM, MAX_MULTIPLIER_UPDATES, PART_CURVATURE_BELOW_MM, PART_CURVATURE_SHARE, WHOLE_CURVATURE_BELOW_MM};
use super::assembly::Curvature;
use super::contact::{ContactPair, penetration};
use super::equations::{Balance, Equations};
use super::failure::Failure;
use super::line_search::{self, NoStep, Start};
use super::dot::dot;
use super::quadratic_model::Bend;
use super::report::IterationRecord;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

/// An equilibrium that was reached.
#[derive(Debug, Clone)]
pub(super) struct Equilibrium {
    pub(super) iterations: usize,
    /// Residual relative to the reaction force, or to the force floor when the reaction is smaller.
    pub(super) relative_residual: f64,
    /// Largest remaining displacement, estimated with the current factor, mm.
    pub(super) remaining_mm: f64,
    pub(super) touches: Vec<ContactPair>,
}

impl Equations<'_> {
    /// Iterates `x` to equilibrium. Its held nodes must be in place, and no element may be inverted.
    pub(super) fn equilibrate(
        &mut self,
        x: &mut [Vector],
        motions: &[Motion],
        t: f64,
        control: &Control,
    ) -> Result<Equilibrium, Failure> {
        self.failed_at.clear();
        self.settles = true;
        let result = self.augmented(x, motions, t, control);
        if result.is_err() {
            self.failed_at = x.to_vec();
        }
        result
    }

    /// Outer iteration of the augmented Lagrangian around Newton's method.
    fn augmented(
        &mut self,
        x: &mut [Vector],
        motions: &[Motion],
        t: f64,
        control: &Control,
    ) -> Result<Equilibrium, Failure> {
        let mut iterations = 0;
        let mut last_penetration = f64::INFINITY;
        let full =
            if self.rough { self.limits.relative_residual.max(COARSE_RESIDUAL) } else { self.limits.relative_residual };
        // Multipliers converge to the contact pressure without an exact equilibrium.
        let mut aim = if self.contact.is_empty() { full } else { full.max(COARSE_RESIDUAL) };
        for _ in 0..=MAX_MULTIPLIER_UPDATES {
            let found = self.newton(x, motions, t, aim, control)?;
            iterations += found.iterations;
            let depth = penetration(&found.touches);
            if depth > self.limits.penetration_tolerance_mm {
                self.contact.augment(&found.touches);
                if depth > 0.25 * last_penetration {
                    self.contact.stiffen(4.0);
                }
                last_penetration = depth;
            } else if aim > full {
                aim = full;
            } else {
                return Ok(Equilibrium { iterations, ..found });
            }
        }
        Err(Failure::Penetration { found_mm: last_penetration })
    }

    /// Iterates until the residual is below `aim` relative to the reactions.
    fn newton(
        &mut self,
        x: &mut [Vector],
        motions: &[Motion],
        t: f64,
        aim: f64,
        control: &Control,
    ) -> Result<Equilibrium, Failure> {
        let mut curvature = Curvature::Exact;
        let (mut bend, mut wait) = (Bend { settled: true, ..Bend::default() }, 0usize);
        let share = if aim > self.limits.relative_residual { COARSE_DISPLACEMENT } else { DISPLACEMENT_TOLERANCE };
        let enough = share * self.limits.element_size_mm;
        let mut last = (f64::INFINITY, 0.0);
        let mut moved_mm = f64::INFINITY;
        for iteration in 0..=self.limits.max_iterations {
            control.check()?;
            self.settles &= iteration < CONDENSED_ITERATIONS;
            let balance = self.balance(x, motions)?;
            let tolerance = aim * balance.reaction_n.max(self.limits.force_floor_n);
            last = (balance.residual_n, tolerance);
            let remaining_mm = if balance.residual_n <= tolerance { self.remaining_change() } else { f64::INFINITY };
            if remaining_mm <= enough {
                return Ok(Equilibrium {
                    iterations: iteration,
                    remaining_mm,
                    relative_residual: aim * balance.residual_n / tolerance,
                    touches: balance.touches,
                });
            }
            if iteration == self.limits.max_iterations {
                break;
            }
            // Inexact Newton: the linear system is solved only as accurately as the next residual needs.
            let forcing = (0.25 * balance.residual_n / balance.reaction_n.max(self.limits.force_floor_n))
                .max(0.1 * tolerance / balance.residual_n)
                .clamp(1e-6, 0.05);
            let mut record = IterationRecord {
                t,
                residual_n: balance.residual_n,
                reaction_n: balance.reaction_n,
                active_contacts: balance.touches.len(),
                ..IterationRecord::default()
            };
            let (d, balance) = self.direction(x, motions, balance, &mut curvature, &mut bend, forcing, &mut record)?;
            let slope = dot(&d, &self.residual);
            let (begin, before) = ((self.clock)(), self.times().total_s());
            let taken = line_search::search(
                self,
                x,
                motions,
                &d,
                &Start {
                    energy: balance.energy,
                    slope,
                    depth: penetration(&balance.touches),
                    unstable: record.unstable,
                },
            );
            let others = self.times().total_s() - before;
            self.times.line_search_s += (self.clock)() - begin - others;
            match taken {
                Ok(step) => {
                    self.dofs.add(step, &d, x);
                    record.step = step;
                    record.displacement_mm = step * self.dofs.max_position_change(&d);
                    self.settles &= record.displacement_mm <= CONDENSED_MAX_RATIO * moved_mm;
                    moved_mm = record.displacement_mm;
                    // A short step shows that the quadratic model was poor.
                    curvature = if step < 0.5 { Curvature::Projected } else { Curvature::Exact };
                    wait = if record.unstable { 2 } else { wait.saturating_sub(1) };
                    bend.settled = wait == 0;
                    bend.share = match record.displacement_mm {
                        _ if wait > 0 || step < 1.0 => 0.0,
                        moved if moved < WHOLE_CURVATURE_BELOW_MM => 1.0,
                        moved if moved < PART_CURVATURE_BELOW_MM => PART_CURVATURE_SHARE,
                        _ => 0.0,
                    };
                    self.records.push(record);
                    let remaining_mm = self.dofs.max_visible_change(&d);
                    if self.rough && step >= 1.0 && remaining_mm <= DISPLAY_STEP_MM {
                        let balance = self.balance(x, motions)?;
                        let reaction_n = balance.reaction_n.max(self.limits.force_floor_n);
                        return Ok(Equilibrium {
                            iterations: iteration + 1,
                            remaining_mm,
                            relative_residual: balance.residual_n / reaction_n,
                            touches: balance.touches,
                        });
                    }
                }
                Err(cut) => {
                    self.records.push(record);
                    if curvature == Curvature::Exact && !self.limits.linear {
                        curvature = Curvature::Projected;
                        self.solver.refresh();
                        continue;
                    }
                    return Err(match cut {
                        NoStep::Inverted(at) => Failure::Inverted(at),
                        NoStep::NoDescent => Failure::NotConverged {
                            iterations: iteration + 1,
                            residual_n: balance.residual_n,
                            tolerance_n: tolerance,
                        },
                    });
                }
            }
        }
        let (residual_n, tolerance_n) = last;
        Err(Failure::NotConverged { iterations: self.limits.max_iterations, residual_n, tolerance_n })
    }

    /// Displacement that the current factor predicts from the residual, mm; infinite when there is no factor.
    fn remaining_change(&mut self) -> f64 {
        if !self.solver.has_factor() {
            return if self.residual.iter().all(|r| *r == 0.0) { 0.0 } else { f64::INFINITY };
        }
        let mut d = self.residual.clone();
        self.solver.precondition(&mut d);
        self.dofs.max_position_change(&d)
    }

    /// A descent direction: the Newton step with the requested tangent, or with the projected one when that tangent is not
    /// positive definite. Multipliers may grow meanwhile, so the balance at `x` is returned with the updated ones.
    fn direction(
        &mut self,
        x: &[Vector],
        motions: &[Motion],
        mut balance: Balance,
        curvature: &mut Curvature,
        bend: &mut Bend,
        forcing: f64,
        record: &mut IterationRecord,
    ) -> Result<(Vec<f64>, Balance), Failure> {
        let mut assembled = None;
        loop {
            if assembled != Some(*curvature) {
                self.tangent(x, *curvature)?;
                assembled = Some(*curvature);
            }
            let mut load = self.forces.clone();
            self.subtract_loads(&mut load);
            let found = self.minimise_model(x, motions, &load, bend, forcing, record);
            if !self.contact.is_empty() {
                balance = self.weigh(balance.elastic, x, motions);
            }
            if let Ok(d) = found {
                record.projected = *curvature == Curvature::Projected;
                if dot(&d, &self.residual) < 0.0 {
                    return Ok((d, balance));
                }
            }
            // A projected tangent is positive definite: when its factorisation fails, the precision was too low.
            if bend.used {
                *bend = Bend::default();
                record.unstable = true;
                continue;
            }
            if *curvature == Curvature::Exact && !self.limits.linear {
                *curvature = Curvature::Projected;
                record.unstable = true;
            } else if self.solver.is_double() {
                return Err(Failure::Indefinite);
            } else {
                self.solver.use_double();
            }
            self.solver.refresh();
        }
    }
}
