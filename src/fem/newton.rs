//! Newton's method on the total potential energy at one position of the bones.

use super::assembly::{Assembly, Curvature, Inversion};
#[cfg(test)]
use super::contact::Curved;
use super::contact::{Contact, Touch, penetration};
use super::dofs::{Dofs, Hold, axes_in};
use super::line_search::{self, Cut, Start};
use super::linear_solve::{LinearSolver, dot};
use super::quadratic_model::Bend;
use super::report::{IterationRecord, PhaseTimes};
use crate::control::{Cancelled, Clock, Control};
use crate::geometry::{Motion, Point, Vector};
use std::sync::Arc;

/// Iterations after which contact is no longer settled beforehand: points that slip over a rim may go round in a circle with it.
const PATIENCE: usize = 6;
/// A step counts as converged only when the remaining displacement is estimated below this share of the element size: 1e-3 mm for
/// elements of 4 mm.
const DISPLACEMENT_TOLERANCE: f64 = 2.5e-4;
/// The same while multipliers are still to be updated.
const COARSE_DISPLACEMENT: f64 = 5e-3;
/// After a whole Newton step shorter than this the contact's curvature is taken into the tangent, mm.
const CURVED_BELOW_MM: f64 = 0.1;
/// After a whole step shorter than this a share of the curvature is, mm: where a point creeps over an edge of the bone, Newton's method without
/// it gains a few per cent each iteration.
const BENT_BELOW_MM: f64 = 0.5;
/// That share: small enough that the tangent mostly stays positive definite.
const BENT_SHARE: f64 = 0.75;
/// Points with a smaller gap may come to touch within one Newton step, mm.
pub(super) const NEAR_MM: f64 = 3.0;
/// A rough equilibrium may be this far from the exact one on the skin, as far as the last Newton step tells, mm.
const VISIBLE_MM: f64 = 0.02;
/// Bone near contact points moves at most this far in one substep, and no line search lets a point sink deeper, mm: else a point
/// could come out on the other side of a thin wall.
pub(super) const MAX_CONTACT_MOTION_MM: f64 = 2.0;
/// Relative residual at which multipliers are updated.
const COARSE_RESIDUAL: f64 = 1e-2;
/// Augmented Lagrangian steps before contact is given up.
const MAX_AUGMENTATIONS: usize = 20;

/// Why there is no equilibrium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Failure {
    Inverted(Inversion),
    NotConverged { iterations: usize, residual_n: f64, tolerance_n: f64 },
    Penetration { found_mm: f64 },
    PassedThrough { body: usize, place: Point },
    Indefinite,
    Cancelled,
}

impl From<Cancelled> for Failure {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<Inversion> for Failure {
    fn from(at: Inversion) -> Self {
        Self::Inverted(at)
    }
}

/// What Newton's method needs to know beside the equations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) relative_residual: f64,
    pub(super) max_iterations: usize,
    pub(super) penetration_tolerance_mm: f64,
    /// Reactions below this count as this, N: scales with shear modulus times element size squared.
    pub(super) force_floor_n: f64,
    /// Size of an element, mm; generalised forces of tangent vectors (N mm) are compared after division by it.
    pub(super) element_size_mm: f64,
    /// Round-off of the energy at rest, mJ: scales with shear modulus times volume.
    pub(super) energy_noise_mj: f64,
    /// The forces are linear in the displacements.
    pub(super) linear: bool,
}

/// Equations of the whole tissue, with their buffers.
#[derive(Debug)]
pub(super) struct Equations<'a> {
    pub(super) dofs: Dofs,
    pub(super) assembly: Assembly,
    /// The elements' stiffness at rest; empty when it is not known.
    rest_stiffness: Arc<Vec<f64>>,
    pub(super) contact: Contact<'a>,
    pub(super) solver: LinearSolver,
    pub(super) limits: Limits,
    pub(super) records: Vec<IterationRecord>,
    pub(super) values: Vec<f64>,
    /// The elements' part of `values`.
    pub(super) elastic: Vec<f64>,
    /// Pairs that push in the last model, ascending.
    pub(super) active: Vec<(usize, usize)>,
    /// Forces of contact by unknown node as it settled last, ascending, N.
    pub(super) settled_forces: Vec<(u32, Vector)>,
    pub(super) forces: Vec<Vector>,
    pub(super) residual: Vec<f64>,
    pub(super) failed_at: Vec<Vector>,
    /// Dead loads at path parameter 1, by mesh node; empty when there are none.
    loads: Vec<Vector>,
    /// Share of the loads that acts.
    pub(super) load_share: f64,
    pub(super) clock: Clock,
    /// All but those that the linear solver counts.
    pub(super) times: PhaseTimes,
    /// An equilibrium that looks right will do.
    pub(super) rough: bool,
    /// Contact is settled before each direction is looked for.
    pub(super) settles: bool,
}

/// A state that was reached.
#[derive(Debug, Clone)]
pub(super) struct Equilibrium {
    pub(super) iterations: usize,
    /// Residual relative to the reaction, or to the floor when the reaction is smaller.
    pub(super) relative_residual: f64,
    /// Largest displacement that is left, as the last factor sees it, mm.
    pub(super) remaining_mm: f64,
    pub(super) touches: Vec<Touch>,
}

/// Forces out of balance at one state.
#[derive(Debug)]
pub(super) struct Balance {
    /// Energy of the elements, mJ.
    elastic: f64,
    /// The whole, mJ.
    pub(super) energy: f64,
    residual_n: f64,
    reaction_n: f64,
    pub(super) touches: Vec<Touch>,
}

impl<'a> Equations<'a> {
    pub(super) fn new(
        dofs: Dofs,
        assembly: Assembly,
        rest: Arc<Vec<f64>>,
        contact: Contact<'a>,
        solver: LinearSolver,
        loads: Vec<Vector>,
        limits: Limits,
        clock: Clock,
    ) -> Self {
        let values = vec![0.0; assembly.pattern().n_values()];
        let elastic = values.clone();
        let forces = vec![Vector::zeros(); dofs.n_nodes()];
        let residual = vec![0.0; 3 * dofs.n_unknown()];
        Self {
            dofs,
            assembly,
            rest_stiffness: rest,
            contact,
            solver,
            limits,
            records: Vec::new(),
            values,
            elastic,
            active: Vec::new(),
            settled_forces: Vec::new(),
            forces,
            residual,
            failed_at: Vec::new(),
            loads,
            load_share: 0.0,
            clock,
            times: PhaseTimes::default(),
            rough: false,
            settles: true,
        }
    }

    /// Puts stable materials in the place of those that can lose ellipticity; whether there were any.
    pub(super) fn stabilise(&mut self) -> bool {
        let changed = self.assembly.stabilise();
        if changed {
            self.rest_stiffness = Arc::default();
            self.solver.refresh();
        }
        changed
    }

    /// Time of the phases so far.
    pub(super) fn times(&self) -> PhaseTimes {
        let (factor_s, solve_s) = self.solver.times();
        PhaseTimes { factor_s, solve_s, ..self.times }
    }

    /// Total energy (mJ) and largest penetration (mm) at `x`.
    pub(super) fn energy(&self, x: &[Vector], motions: &[Motion]) -> Result<(f64, f64), Inversion> {
        let touches = self.contact.touches(x, motions);
        let energy = self.assembly.energy(x)? + self.contact.energy(&touches) - self.work_of_loads(x);
        Ok((energy, penetration(&touches)))
    }

    /// Work of the dead loads from rest to `x`, mJ.
    fn work_of_loads(&self, x: &[Vector]) -> f64 {
        let moved = x.iter().zip(self.dofs.rest());
        self.load_share * self.loads.iter().zip(moved).map(|(f, (x, rest))| f.dot(&(x - rest))).sum::<f64>()
    }

    /// Takes the dead loads off the gradient of the energy.
    pub(super) fn subtract_loads(&self, gradient: &mut [Vector]) {
        gradient.iter_mut().zip(&self.loads).for_each(|(g, f)| *g -= f * self.load_share);
    }

    /// Gradient of the total energy by the unknowns, in `self.residual`, and of the elements' part by all nodes in `self.forces`.
    pub(super) fn balance(&mut self, x: &[Vector], motions: &[Motion]) -> Result<Balance, Inversion> {
        let begin = (self.clock)();
        let elastic = self.assembly.forces(x, &mut self.forces)?;
        self.times.residual_s += (self.clock)() - begin;
        Ok(self.weigh(elastic, x, motions))
    }

    /// [`Equations::balance`] with the elements' energy known and their forces at `x` in `self.forces`.
    fn weigh(&mut self, elastic: f64, x: &[Vector], motions: &[Motion]) -> Balance {
        let begin = (self.clock)();
        let touches = self.contact.touches(x, motions);
        let searched = (self.clock)();
        self.times.contact_s += searched - begin;
        let energy = elastic + self.contact.energy(&touches) - self.work_of_loads(x);
        let mut pushed = vec![Vector::zeros(); self.dofs.n_nodes()];
        self.contact.add_forces(&touches, &mut pushed);
        let mut reaction = 0.0;
        for (node, hold) in self.dofs.holds().iter().enumerate() {
            let scale = self.unit(node);
            reaction += scale * scale * pushed[node].norm_squared();
            if *hold != Hold::Free {
                reaction += scale * scale * self.forces[node].norm_squared();
            } else {
                let held = axes_in(self.dofs.axes_of(node)).map(|axis| self.forces[node][axis].powi(2));
                reaction += scale * scale * held.sum::<f64>();
            }
        }
        reaction += self.loads.iter().map(|f| (f * self.load_share).norm_squared()).sum::<f64>();
        let mut total: Vec<Vector> = self.forces.iter().zip(&pushed).map(|(a, b)| a + b).collect();
        self.subtract_loads(&mut total);
        self.dofs.restrict(&total, &mut self.residual);
        let residual: f64 = (self.dofs.nodes().iter().zip(self.residual.chunks_exact(3)))
            .map(|(&node, r)| self.unit(node as usize).powi(2) * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]))
            .sum();
        self.times.residual_s += (self.clock)() - searched;
        Balance { elastic, energy, residual_n: residual.sqrt(), reaction_n: reaction.sqrt(), touches }
    }

    fn unit(&self, node: usize) -> f64 {
        if self.dofs.is_position(node) { 1.0 } else { 1.0 / self.limits.element_size_mm }
    }

    /// Exact stiffness of elements and contact at `x`, in `self.values`.
    #[cfg(test)]
    pub(super) fn stiffness(&mut self, x: &[Vector], touches: &[Touch], motions: &[Motion]) -> Result<(), Inversion> {
        self.assembly.tangent(x, Curvature::Exact, &mut self.forces, &mut self.elastic)?;
        self.add_contact(touches, Some(Curved { x, motions, share: 1.0 }));
        Ok(())
    }

    /// Points that may come to touch within one step.
    pub(super) fn near(&mut self, x: &[Vector], motions: &[Motion]) -> Vec<Touch> {
        let begin = (self.clock)();
        let near = self.contact.near(x, motions, NEAR_MM);
        self.times.contact_s += (self.clock)() - begin;
        near
    }

    /// The elements' stiffness in `self.elastic`, their forces in `self.forces`.
    pub(super) fn tangent(&mut self, x: &[Vector], curvature: Curvature) -> Result<(), Inversion> {
        if curvature == Curvature::Exact && !self.rest_stiffness.is_empty() && x == self.dofs.rest() {
            self.elastic.copy_from_slice(&self.rest_stiffness);
            return self.assembly.forces(x, &mut self.forces).map(|_| ());
        }
        let begin = (self.clock)();
        let done = self.assembly.tangent(x, curvature, &mut self.forces, &mut self.elastic);
        self.assembly.pattern().hold(self.dofs.partly_held(), &mut self.elastic);
        self.times.tangent_s += (self.clock)() - begin;
        done
    }

    /// Time of the phases since the last call.
    pub(super) fn take_times(&mut self) -> PhaseTimes {
        let times = self.times();
        self.times = PhaseTimes::default();
        self.solver.forget_times();
        times
    }

    /// Brings `x`, whose held nodes are in place and in which no element is inverted, to equilibrium.
    pub(super) fn equilibrate(
        &mut self,
        x: &mut [Vector],
        motions: &[Motion],
        t: f64,
        control: &Control,
    ) -> Result<Equilibrium, Failure> {
        self.failed_at.clear();
        let result = self.augmented(x, motions, t, control);
        if result.is_err() {
            self.failed_at = x.to_vec();
        }
        result
    }

    /// Newton's method within the augmented Lagrangian's outer iteration.
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
        // The multipliers need no exact equilibrium to grow towards the contact pressure.
        let mut aim = if self.contact.is_empty() { full } else { full.max(COARSE_RESIDUAL) };
        for _ in 0..=MAX_AUGMENTATIONS {
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
        for iteration in 0..=self.limits.max_iterations {
            control.check()?;
            self.settles = iteration < PATIENCE;
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
            // Inexact Newton: the linear system needs no more digits than the next residual can use.
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
            let taken = line_search::along(
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
                    // A short step says that the quadratic model was poor.
                    curvature = if step < 0.5 { Curvature::Projected } else { Curvature::Exact };
                    wait = if record.unstable { 2 } else { wait.saturating_sub(1) };
                    bend.settled = wait == 0;
                    bend.share = match record.displacement_mm {
                        _ if wait > 0 || step < 1.0 => 0.0,
                        moved if moved < CURVED_BELOW_MM => 1.0,
                        moved if moved < BENT_BELOW_MM => BENT_SHARE,
                        _ => 0.0,
                    };
                    self.records.push(record);
                    let remaining_mm = self.dofs.max_visible_change(&d);
                    if self.rough && step >= 1.0 && remaining_mm <= VISIBLE_MM {
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
                        Cut::Inverted(at) => Failure::Inverted(at),
                        Cut::NoDescent => Failure::NotConverged {
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

    /// Displacement that the last factor predicts from the present residual, mm; infinite when there is no factor.
    fn remaining_change(&mut self) -> f64 {
        if !self.solver.has_factor() {
            return if self.residual.iter().all(|r| *r == 0.0) { 0.0 } else { f64::INFINITY };
        }
        let mut d = self.residual.clone();
        self.solver.precondition(&mut d);
        self.dofs.max_position_change(&d)
    }

    /// A descent direction: Newton's with the tangent asked for, with the projected one when that is not positive definite. Multipliers may
    /// grow on the way: with it comes the balance at `x` with the present ones.
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
            // A projected tangent is positive definite: if the factor says otherwise, its precision was too low.
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

    /// Force of tied nodes and contact of each segment on the tissue at `x`, N.
    pub(super) fn reactions(&mut self, x: &[Vector], motions: &[Motion], segments: &[u32]) -> Vec<(u32, [f64; 3])> {
        let mut sums = vec![Vector::zeros(); segments.len()];
        let touches = self.contact.touches(x, motions);
        if self.balance(x, motions).is_ok() {
            for (node, hold) in self.dofs.holds().iter().enumerate() {
                if let (Hold::Segment(segment), true) = (hold, self.dofs.is_position(node))
                    && let Ok(place) = segments.binary_search(segment)
                {
                    sums[place] += self.forces[node];
                }
            }
        }
        for (body, force) in self.contact.bodies().iter().zip(self.contact.forces_by_body(&touches)) {
            if let Ok(place) = segments.binary_search(&body.segment) {
                sums[place] += force;
            }
        }
        segments.iter().zip(sums).map(|(s, f)| (*s, f.into())).collect()
    }

    /// The last configuration that Newton's method looked at when it failed.
    pub(super) fn last_iterate(&self) -> Option<&[Vector]> {
        (!self.failed_at.is_empty()).then_some(self.failed_at.as_slice())
    }
}
