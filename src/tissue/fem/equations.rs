//! Energy, balance of forces and reactions at one state of the tissue.

#[cfg(test)]
use super::assembly::Curvature;
use super::assembly::Inversion;
use super::axes::axes_in;
#[cfg(test)]
use super::contact::Curved;
use super::contact::{ContactPair, penetration};
use super::dofs::Condition;
use super::linear_solve::LinearSolver;
use super::problem::Problem;
#[cfg(test)]
use super::springs::Bend;
use super::springs::TangentKind;
use super::state::PathState;
use super::tuning::NEAR_MM;
use super::workspace::Workspace;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

/// Problem, state and workspace of one solver.
#[derive(Debug)]
pub(super) struct Equations<'a> {
    pub(super) problem: Problem,
    pub(super) state: PathState<'a>,
    pub(super) work: Workspace,
}

/// Energy and penetration at one state.
#[derive(Debug, Clone, Copy)]
pub(super) struct EnergyAt {
    /// Total energy, mJ.
    pub(super) energy: f64,
    /// Largest penetration, mm.
    pub(super) penetration_mm: f64,
}

/// Forces out of balance at one state.
#[derive(Debug)]
pub(super) struct Balance {
    /// Energy of elements and springs, mJ.
    pub(super) elastic: f64,
    /// Total energy, mJ.
    pub(super) energy: f64,
    pub(super) residual_n: f64,
    pub(super) reaction_n: f64,
    /// Active contacts.
    pub(super) contacts: Vec<ContactPair>,
}

impl<'a> Equations<'a> {
    pub(super) fn new(problem: Problem, state: PathState<'a>, solver: LinearSolver) -> Self {
        let work = Workspace::new(&problem, solver);
        Self { problem, state, work }
    }

    /// From now on `control` stops every loop over elements, contacts and iterations.
    pub(super) fn watch(&mut self, control: &Control) {
        self.state.control = control.clone();
        self.work.solver_mut().set_control(control);
    }

    /// Replaces materials that can lose ellipticity by stable ones. Returns whether there were any.
    pub(super) fn stabilise(&mut self) -> bool {
        let changed = self.problem.stabilise();
        if changed {
            self.work.solver_mut().refresh();
        }
        changed
    }

    /// Total energy and largest penetration at `x`.
    pub(super) fn energy(&self, x: &[Vector], motions: &[Motion]) -> Result<EnergyAt, Inversion> {
        let contact = &self.state.contact;
        let contacts = contact.active_contacts(x, motions);
        let energy =
            self.problem.assembly().energy(x)? + self.state.springs.energy(x, motions) + contact.energy(&contacts)
                - self.problem.work_of_loads(x, self.state.load_share);
        Ok(EnergyAt { energy, penetration_mm: penetration(&contacts) })
    }

    /// Computes the gradient of the energy of elements and springs in the workspace. Returns that energy, mJ.
    pub(super) fn compute_forces(&mut self, x: &[Vector], motions: &[Motion]) -> Result<f64, Inversion> {
        let elastic = self.work.compute_forces(&self.problem, x)?;
        self.work.add_springs(&self.problem, self.state.springs.gradients(x, motions));
        Ok(elastic + self.state.springs.energy(x, motions))
    }

    /// Computes the stiffness of elements and springs, and their forces, in the workspace.
    pub(super) fn tangent(&mut self, x: &[Vector], motions: &[Motion], kind: TangentKind) -> Result<(), Inversion> {
        let springs = self.state.springs.stiffness_at(x, motions);
        self.work.tangent(&self.problem, x, kind.elements(), kind.springs(springs))?;
        self.work.add_springs(&self.problem, self.state.springs.gradients(x, motions));
        Ok(())
    }

    /// The state after the share `step` of a change `d` of the unknowns. Gliding nodes follow the surface of their bodies.
    pub(super) fn moved(&self, x: &[Vector], motions: &[Motion], step: f64, d: &[f64]) -> Vec<Vector> {
        let mut moved = x.to_vec();
        self.problem.dofs().add(step, d, &mut moved);
        if !self.state.springs.is_empty() {
            self.state.springs.retract(x, motions, self.problem.dofs(), &mut moved);
        }
        moved
    }

    /// Whether the iterates have diverged: a node has moved farther than the held nodes, by more than the size of the mesh.
    ///
    /// Below such an energy there is no minimum (a Yeoh material with a negative constant), and paths of metres through bone
    /// would be searched for passages.
    pub(super) fn strays(&self, x: &[Vector]) -> bool {
        let dofs = self.problem.dofs();
        let moved_sq = |node: usize| (x[node] - dofs.rest()[node]).norm_squared();
        let positions = || (0..dofs.n_nodes()).filter(|&node| dofs.is_position(node));
        let is_held = |node: &usize| dofs.conditions()[*node] != Condition::Free;
        let held_mm = positions().filter(is_held).map(moved_sq).fold(0.0, f64::max).sqrt();
        let reach_sq = (held_mm + self.problem.limits().mesh_size_mm).powi(2);
        positions().map(moved_sq).any(|moved_sq| !moved_sq.is_finite() || moved_sq > reach_sq)
    }

    /// Lets go of gliding nodes on which bone pulls too much. Returns their number.
    pub(super) fn pull_off(&mut self, x: &[Vector], motions: &[Motion]) -> usize {
        match self.problem.limits().pull_off_mpa {
            Some(limit) => self.state.springs.pull_off(x, motions, limit),
            None => 0,
        }
    }

    /// Subtracts the dead loads from the gradient of the energy.
    pub(super) fn subtract_loads(&self, gradient: &mut [Vector]) {
        self.problem.subtract_loads(gradient, self.state.load_share);
    }

    /// Computes the gradients of the total energy by the unknowns and of the elements' energy by all nodes in the workspace.
    pub(super) fn balance(&mut self, x: &[Vector], motions: &[Motion]) -> Result<Balance, Inversion> {
        let begin = self.problem.now();
        let elastic = self.compute_forces(x, motions)?;
        self.work.times_mut().residual_s += self.problem.now() - begin;
        Ok(self.balance_of(elastic, x, motions))
    }

    /// [`Equations::balance`] when the energy of elements and springs is known and the workspace has their forces at `x`.
    pub(super) fn balance_of(&mut self, elastic: f64, x: &[Vector], motions: &[Motion]) -> Balance {
        let begin = self.problem.now();
        let (contact, load_share) = (&self.state.contact, self.state.load_share);
        let contacts = contact.active_contacts(x, motions);
        let searched = self.problem.now();
        self.work.times_mut().contact_s += searched - begin;
        let energy = elastic + contact.energy(&contacts) - self.problem.work_of_loads(x, load_share);
        let mut pushed = vec![Vector::zeros(); self.problem.dofs().n_nodes()];
        contact.add_forces(&contacts, &mut pushed);
        let reaction = self.squared_reactions(&pushed);
        let mut total: Vec<Vector> = self.work.forces().iter().zip(&pushed).map(|(a, b)| a + b).collect();
        self.problem.subtract_loads(&mut total, load_share);
        self.work.set_residual(&self.problem, &total);
        let nodes = self.problem.dofs().nodes();
        let residual: f64 = (nodes.iter().zip(self.work.residual().chunks_exact(3)))
            .map(|(&node, r)| {
                self.problem.force_unit(node as usize).powi(2) * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            })
            .sum();
        self.work.times_mut().residual_s += self.problem.now() - searched;
        Balance { elastic, energy, residual_n: residual.sqrt(), reaction_n: reaction.sqrt(), contacts }
    }

    /// Sum of squares of the forces of contact (`pushed`), held nodes and loads, N².
    fn squared_reactions(&self, pushed: &[Vector]) -> f64 {
        let (dofs, forces) = (self.problem.dofs(), self.work.forces());
        let mut reaction = 0.0;
        for (node, condition) in dofs.conditions().iter().enumerate() {
            let scale = self.problem.force_unit(node);
            reaction += scale * scale * pushed[node].norm_squared();
            if *condition != Condition::Free {
                reaction += scale * scale * forces[node].norm_squared();
            } else {
                let held = axes_in(dofs.axes_of(node)).map(|axis| forces[node][axis].powi(2));
                reaction += scale * scale * held.sum::<f64>();
            }
        }
        for (point, gradient) in self.problem.spring_points().iter().zip(self.work.spring_gradients()) {
            reaction += self.problem.force_unit(point.node as usize).powi(2) * gradient.norm_squared();
        }
        reaction += self.problem.squared_loads(self.state.load_share);
        reaction
    }

    /// Computes the exact stiffness of elements and contact at `x` in the workspace.
    #[cfg(test)]
    pub(super) fn stiffness(
        &mut self,
        x: &[Vector],
        contacts: &[ContactPair],
        motions: &[Motion],
    ) -> Result<(), Inversion> {
        let springs = self.state.springs.stiffness_at(x, motions);
        self.work.tangent(&self.problem, x, Curvature::Exact, Bend::Whole(springs))?;
        let curved = Some(Curved { x, motions, share: 1.0 });
        self.work.add_contact(&self.problem, &self.state.contact, contacts, curved);
        Ok(())
    }

    /// Contacts that may become active within one Newton step.
    pub(super) fn near(&mut self, x: &[Vector], motions: &[Motion]) -> Vec<ContactPair> {
        let begin = self.problem.now();
        let near = self.state.contact.near(x, motions, NEAR_MM);
        self.work.times_mut().contact_s += self.problem.now() - begin;
        near
    }

    /// Force of each segment on the tissue at `x`, from tied nodes and contact, N.
    pub(super) fn reactions(&mut self, x: &[Vector], motions: &[Motion], segments: &[u32]) -> Vec<(u32, [f64; 3])> {
        let mut sums = vec![Vector::zeros(); segments.len()];
        let contacts = self.state.contact.active_contacts(x, motions);
        if self.balance(x, motions).is_ok() {
            let dofs = self.problem.dofs();
            for (node, condition) in dofs.conditions().iter().enumerate() {
                if let (Condition::Segment(segment), true) = (condition, dofs.is_position(node))
                    && let Ok(place) = segments.binary_search(segment)
                {
                    sums[place] += self.work.forces()[node];
                }
            }
        }
        let contact = &self.state.contact;
        for (body, force) in contact.bodies().iter().zip(contact.forces_by_body(&contacts)) {
            if let Ok(place) = segments.binary_search(&body.segment) {
                sums[place] += force;
            }
        }
        for (segment, force) in self.state.springs.forces_by_segment(x, motions) {
            if let Ok(place) = segments.binary_search(&segment) {
                sums[place] += force;
            }
        }
        segments.iter().zip(sums).map(|(s, f)| (*s, f.into())).collect()
    }
}
