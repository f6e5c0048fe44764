//! The equations of the tissue at one state: energy, forces, stiffness, reactions.

use super::tuning::NEAR_MM;
use super::assembly::{Assembly, Curvature, Inversion};
#[cfg(test)]
use super::contact::Curved;
use super::contact::{Contact, ContactPair, penetration};
use super::axes::axes_in;
use super::dofs::{Dofs, Condition};
use super::linear_solve::LinearSolver;
use super::report::{IterationRecord, PhaseTimes};
use prosopon_geometry::control::Clock;
use prosopon_geometry::{Motion, Vector};
use std::sync::Arc;

/// Tolerances and scales of Newton's method.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) relative_residual: f64,
    pub(super) max_iterations: usize,
    pub(super) penetration_tolerance_mm: f64,
    /// Smaller reactions are raised to this value in the convergence test, N: scales with shear modulus times element size
    /// squared.
    pub(super) force_floor_n: f64,
    /// Element size, mm; generalised forces of tangent vectors (N mm) are divided by it before comparison.
    pub(super) element_size_mm: f64,
    /// Round-off error of the energy at rest, mJ: scales with shear modulus times volume.
    pub(super) energy_noise_mj: f64,
    /// Whether the forces are linear in the displacements.
    pub(super) linear: bool,
}

/// State and kind of curvature at which a stiffness was assembled.
type Place = (Vec<Vector>, Curvature);

/// Equations of the whole tissue, with their buffers.
#[derive(Debug)]
pub(super) struct Equations<'a> {
    pub(super) dofs: Dofs,
    pub(super) assembly: Assembly,
    /// Stiffness of the elements at rest; empty when unknown.
    rest_stiffness: Arc<Vec<f64>>,
    pub(super) contact: Contact<'a>,
    pub(super) solver: LinearSolver,
    pub(super) limits: Limits,
    pub(super) records: Vec<IterationRecord>,
    pub(super) values: Vec<f64>,
    /// Stiffness of the elements, without contact.
    pub(super) elastic: Vec<f64>,
    /// State at which `elastic` was assembled.
    assembled: Option<Place>,
    /// State at which the current factor was assembled; `None` for the factor at rest with which the solver started.
    pub(super) factored: Option<Place>,
    /// Active pairs of contact point and body in the last quadratic model, ascending.
    pub(super) active: Vec<(usize, usize)>,
    /// Contact forces by unknown node from the last converged condensed contact solve, ascending, N.
    pub(super) contact_forces: Vec<(u32, Vector)>,
    pub(super) forces: Vec<Vector>,
    pub(super) residual: Vec<f64>,
    pub(super) failed_at: Vec<Vector>,
    /// Dead loads at path parameter 1, by mesh node; empty when there are none.
    loads: Vec<Vector>,
    /// Share of the loads and prescribed displacements that is applied.
    pub(super) load_share: f64,
    pub(super) clock: Clock,
    /// Time of the phases that the linear solver does not measure.
    pub(super) times: PhaseTimes,
    /// Whether an equilibrium for display suffices.
    pub(super) rough: bool,
    /// Whether contact is solved on the condensed system before each Newton direction.
    pub(super) settles: bool,
}

/// Forces out of balance at one state.
#[derive(Debug)]
pub(super) struct Balance {
    /// Energy of the elements, mJ.
    pub(super) elastic: f64,
    /// Total energy, mJ.
    pub(super) energy: f64,
    pub(super) residual_n: f64,
    pub(super) reaction_n: f64,
    pub(super) touches: Vec<ContactPair>,
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
            assembled: None,
            factored: None,
            active: Vec::new(),
            contact_forces: Vec::new(),
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

    /// Replaces materials that can lose ellipticity by stable ones. Returns whether there were any.
    pub(super) fn stabilise(&mut self) -> bool {
        let changed = self.assembly.stabilise();
        if changed {
            self.rest_stiffness = Arc::default();
            self.solver.refresh();
        }
        changed
    }

    /// Time of the phases since the last call of [`Equations::take_times`].
    pub(super) fn times(&self) -> PhaseTimes {
        let (factor_s, solve_s) = self.solver.times();
        PhaseTimes { factor_s, solve_s, ..self.times }
    }

    /// Total energy (mJ) and largest penetration (mm) at `x`.
    pub(super) fn energy(&self, x: &[Vector], motions: &[Motion]) -> Result<(f64, f64), Inversion> {
        let touches = self.contact.active_contacts(x, motions);
        let energy = self.assembly.energy(x)? + self.contact.energy(&touches) - self.work_of_loads(x);
        Ok((energy, penetration(&touches)))
    }

    /// Work of the dead loads from rest to `x`, mJ.
    fn work_of_loads(&self, x: &[Vector]) -> f64 {
        let moved = x.iter().zip(self.dofs.rest());
        self.load_share * self.loads.iter().zip(moved).map(|(f, (x, rest))| f.dot(&(x - rest))).sum::<f64>()
    }

    /// Subtracts the dead loads from the gradient of the energy.
    pub(super) fn subtract_loads(&self, gradient: &mut [Vector]) {
        gradient.iter_mut().zip(&self.loads).for_each(|(g, f)| *g -= f * self.load_share);
    }

    /// Computes the gradient of the total energy by the unknowns (`self.residual`) and of the elements' energy by all nodes
    /// (`self.forces`).
    pub(super) fn balance(&mut self, x: &[Vector], motions: &[Motion]) -> Result<Balance, Inversion> {
        let begin = (self.clock)();
        let elastic = self.assembly.forces(x, &mut self.forces)?;
        self.times.residual_s += (self.clock)() - begin;
        Ok(self.weigh(elastic, x, motions))
    }

    /// [`Equations::balance`] when the elements' energy is known and their forces at `x` are in `self.forces`.
    pub(super) fn weigh(&mut self, elastic: f64, x: &[Vector], motions: &[Motion]) -> Balance {
        let begin = (self.clock)();
        let touches = self.contact.active_contacts(x, motions);
        let searched = (self.clock)();
        self.times.contact_s += searched - begin;
        let energy = elastic + self.contact.energy(&touches) - self.work_of_loads(x);
        let mut pushed = vec![Vector::zeros(); self.dofs.n_nodes()];
        self.contact.add_forces(&touches, &mut pushed);
        let mut reaction = 0.0;
        for (node, hold) in self.dofs.holds().iter().enumerate() {
            let scale = self.unit(node);
            reaction += scale * scale * pushed[node].norm_squared();
            if *hold != Condition::Free {
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

    /// Computes the exact stiffness of elements and contact at `x` in `self.values`.
    #[cfg(test)]
    pub(super) fn stiffness(&mut self, x: &[Vector], touches: &[ContactPair], motions: &[Motion]) -> Result<(), Inversion> {
        self.assembly.tangent(x, Curvature::Exact, &mut self.forces, &mut self.elastic)?;
        self.add_contact(touches, Some(Curved { x, motions, share: 1.0 }));
        Ok(())
    }

    /// Contacts that may become active within one Newton step.
    pub(super) fn near(&mut self, x: &[Vector], motions: &[Motion]) -> Vec<ContactPair> {
        let begin = (self.clock)();
        let near = self.contact.near(x, motions, NEAR_MM);
        self.times.contact_s += (self.clock)() - begin;
        near
    }

    /// Factorises `self.elastic` when the solver has no usable factor.
    pub(super) fn prepare(&mut self) {
        let before = self.solver.factorisations();
        self.solver.prepare(self.assembly.pattern(), &self.elastic);
        self.note_factor(before);
    }

    /// Records the state of the factor, if the number of factorisations exceeds `before`.
    pub(super) fn note_factor(&mut self, before: usize) {
        if self.solver.factorisations() > before {
            self.factored.clone_from(&self.assembled);
        }
    }

    /// Computes the elements' stiffness in `self.elastic` and their forces in `self.forces`.
    pub(super) fn tangent(&mut self, x: &[Vector], curvature: Curvature) -> Result<(), Inversion> {
        let place = self.assembled.get_or_insert_with(|| (Vec::new(), curvature));
        place.0.clear();
        place.0.extend_from_slice(x);
        place.1 = curvature;
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

    /// Force of each segment on the tissue at `x`, from tied nodes and contact, N.
    pub(super) fn reactions(&mut self, x: &[Vector], motions: &[Motion], segments: &[u32]) -> Vec<(u32, [f64; 3])> {
        let mut sums = vec![Vector::zeros(); segments.len()];
        let touches = self.contact.active_contacts(x, motions);
        if self.balance(x, motions).is_ok() {
            for (node, hold) in self.dofs.holds().iter().enumerate() {
                if let (Condition::Segment(segment), true) = (hold, self.dofs.is_position(node))
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

    /// The last iterate of Newton's method when it failed.
    pub(super) fn last_iterate(&self) -> Option<&[Vector]> {
        (!self.failed_at.is_empty()).then_some(self.failed_at.as_slice())
    }
}
