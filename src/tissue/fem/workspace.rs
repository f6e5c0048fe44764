//! Matrices, factor and buffers of the solver. Their contents follow from problem and state, except that the factor may belong
//! to an older state.

use super::assembly::{Curvature, ElementBuffers, Inversion};
use super::axes::axes_in;
use super::compliance::RankOne;
use super::contact::{Contact, ContactPair, Curved};
use super::coupling::Coupling;
use super::factor_origin::{FactorOrigin, numbers, vectors};
use super::failure::Failure;
use super::linear_solve::{LinearSolver, System, Work};
use super::problem::Problem;
use super::report::PhaseTimes;
use super::springs::{Bend, SpringBlocks, add_blocks};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;

/// State and kind of curvature at which a stiffness was assembled.
#[derive(Debug, Clone)]
struct AssemblyState {
    x: Vec<Vector>,
    curvature: Curvature,
    springs: SpringBlocks,
}

/// Factor of a solver, and the nodes whose compliance is known, in the groups in which they were added.
#[derive(Debug)]
pub(super) struct FactorState {
    pub(super) origin: FactorOrigin,
    pub(super) known_compliance: Vec<Vec<u32>>,
}

/// Matrices, factor and buffers.
#[derive(Debug)]
pub(super) struct Workspace {
    solver: LinearSolver,
    buffers: ElementBuffers,
    /// Stiffness of elements and contact.
    values: Vec<f64>,
    /// Stiffness of contact between nodes of no common element.
    coupling: Coupling,
    /// Stiffness of the elements, without contact.
    elastic: Vec<f64>,
    /// State at which `elastic` was assembled.
    assembled: Option<AssemblyState>,
    /// State at which the current factor was assembled; `None` for the factor at rest with which the solver started.
    factored: Option<AssemblyState>,
    /// Gradient of the energy of elements and springs by all nodes.
    forces: Vec<Vector>,
    /// The springs' part of it, by point.
    spring_gradients: Vec<Vector>,
    /// Gradient of the total energy by the unknowns.
    residual: Vec<f64>,
    /// Time of the phases that the linear solver does not measure.
    times: PhaseTimes,
}

impl Workspace {
    pub(super) fn new(problem: &Problem, solver: LinearSolver) -> Self {
        let values = vec![0.0; problem.pattern().n_values()];
        Self {
            solver,
            buffers: problem.assembly().buffers(),
            elastic: values.clone(),
            values,
            coupling: Coupling::default(),
            assembled: None,
            factored: None,
            forces: vec![Vector::zeros(); problem.dofs().n_nodes()],
            spring_gradients: Vec::new(),
            residual: vec![0.0; 3 * problem.dofs().n_unknown()],
            times: PhaseTimes::default(),
        }
    }

    pub(super) fn solver(&self) -> &LinearSolver {
        &self.solver
    }

    pub(super) fn solver_mut(&mut self) -> &mut LinearSolver {
        &mut self.solver
    }

    /// Gradient of the energy of elements and springs by all nodes.
    pub(super) fn forces(&self) -> &[Vector] {
        &self.forces
    }

    /// The springs' part of [`Workspace::forces`], by point.
    pub(super) fn spring_gradients(&self) -> &[Vector] {
        &self.spring_gradients
    }

    /// Adds the springs' gradients to the forces of the elements.
    pub(super) fn add_springs(&mut self, problem: &Problem, gradients: Vec<Vector>) {
        for (point, gradient) in problem.spring_points().iter().zip(&gradients) {
            self.forces[point.node as usize] += gradient;
        }
        self.spring_gradients = gradients;
    }

    /// Gradient of the total energy by the unknowns.
    pub(super) fn residual(&self) -> &[f64] {
        &self.residual
    }

    /// Product of the stiffness of elements and contact with `x`.
    pub(super) fn multiply(&self, problem: &Problem, x: &[f64], y: &mut [f64]) {
        problem.pattern().multiply(&self.values, x, y);
        self.coupling.add_product(x, y);
    }

    /// Stiffness of the elements.
    pub(super) fn elastic(&self) -> &[f64] {
        &self.elastic
    }

    /// Time of the phases that the linear solver does not measure.
    pub(super) fn times_mut(&mut self) -> &mut PhaseTimes {
        &mut self.times
    }

    /// Time of the phases since the last call of [`Workspace::take_times`].
    pub(super) fn times(&self) -> PhaseTimes {
        let of_solver = self.solver.times();
        PhaseTimes { factor_s: of_solver.factor_s, solve_s: of_solver.solve_s, ..self.times }
    }

    /// Time of the phases since the last call.
    pub(super) fn take_times(&mut self) -> PhaseTimes {
        let times = self.times();
        self.times = PhaseTimes::default();
        self.solver.forget_times();
        times
    }

    /// Computes the elements' forces. Returns their energy, mJ.
    pub(super) fn compute_forces(&mut self, problem: &Problem, x: &[Vector]) -> Result<f64, Inversion> {
        problem.assembly().forces(&mut self.buffers, x, &mut self.forces)
    }

    /// First-order change of the elements' forces for a change `dx` of the nodes.
    pub(super) fn force_change(
        &mut self,
        problem: &Problem,
        x: &[Vector],
        dx: &[Vector],
        change: &mut [Vector],
    ) -> Result<(), Inversion> {
        problem.assembly().force_change(&mut self.buffers, x, dx, change)
    }

    /// Sets the residual to the entries of the unknowns in `total`.
    pub(super) fn set_residual(&mut self, problem: &Problem, total: &[Vector]) {
        problem.dofs().restrict(total, &mut self.residual);
    }

    /// Computes the stiffness of elements and `springs`, and the elements' forces.
    pub(super) fn tangent(
        &mut self,
        problem: &Problem,
        x: &[Vector],
        curvature: Curvature,
        springs: Bend,
    ) -> Result<(), Inversion> {
        let done = self.element_tangent(problem, x, curvature);
        let points = problem.spring_points();
        let springs = add_blocks(problem.dofs(), problem.pattern(), points, springs, &mut self.elastic);
        if let Some(assembled) = &mut self.assembled {
            assembled.springs = springs;
        }
        done
    }

    fn element_tangent(&mut self, problem: &Problem, x: &[Vector], curvature: Curvature) -> Result<(), Inversion> {
        let assembled = self.assembled.get_or_insert_with(|| AssemblyState {
            x: Vec::new(),
            curvature,
            springs: SpringBlocks::default(),
        });
        assembled.x.clear();
        assembled.x.extend_from_slice(x);
        assembled.curvature = curvature;
        if let (Curvature::Exact, Some(known)) = (curvature, problem.known_stiffness(x)) {
            self.elastic.copy_from_slice(known);
            return self.compute_forces(problem, x).map(|_| ());
        }
        let begin = problem.now();
        let done = problem.assembly().tangent(&mut self.buffers, x, curvature, &mut self.forces, &mut self.elastic);
        problem.pattern().hold(problem.dofs().partly_held(), &mut self.elastic);
        self.times.tangent_s += problem.now() - begin;
        done
    }

    /// Computes the stiffness of the elements and of `contacts`.
    pub(super) fn add_contact(
        &mut self,
        problem: &Problem,
        contact: &Contact<'_>,
        contacts: &[ContactPair],
        curved: Option<Curved<'_>>,
    ) {
        self.values.copy_from_slice(&self.elastic);
        self.coupling.clear();
        let (pattern, dofs) = (problem.pattern(), problem.dofs());
        let (values, coupling) = (&mut self.values, &mut self.coupling);
        let axes = |unknown: u32| axes_in(dofs.axes_of(dofs.nodes()[unknown as usize] as usize));
        contact.hessian(contacts, curved, dofs, |row, column, block| {
            if pattern.contains(row, column) {
                return pattern.add(row, column, block, values);
            }
            let mut block = *block;
            axes(row).for_each(|axis| block.row_mut(axis).fill(0.0));
            axes(column).for_each(|axis| block.column_mut(axis).fill(0.0));
            coupling.add(row, column, block);
        });
        coupling.merge();
        pattern.hold(dofs.partly_held(), values);
    }

    /// Factorises the elements' stiffness when the solver has no usable factor.
    pub(super) fn prepare(&mut self, problem: &Problem) {
        let before = self.solver.factorisations();
        self.solver.prepare(problem.pattern(), &self.elastic);
        self.note_factor(before);
    }

    /// Solves the system with the stiffness of elements and contact; `terms` is the Gauss-Newton part of contact.
    pub(super) fn solve(
        &mut self,
        problem: &Problem,
        terms: &[RankOne],
        rhs: &[f64],
        change: &mut [f64],
        tolerance: f64,
        norm_sq: Option<f64>,
    ) -> Result<Work, Failure> {
        let system = System { values: &self.values, coupling: &self.coupling, elastic: &self.elastic, contact: terms };
        let before = self.solver.factorisations();
        let work = self.solver.solve(problem.pattern(), system, rhs, change, tolerance, norm_sq);
        self.note_factor(before);
        work
    }

    /// Records the state of the factor, if the number of factorisations exceeds `before`.
    fn note_factor(&mut self, before: usize) {
        if self.solver.factorisations() > before {
            self.factored.clone_from(&self.assembled);
        }
    }

    /// Displacement that the current factor predicts from the residual, mm; infinite when there is no factor.
    pub(super) fn remaining_change(&mut self, problem: &Problem) -> f64 {
        if !self.solver.has_factor() {
            return if self.residual.iter().all(|r| *r == 0.0) { 0.0 } else { f64::INFINITY };
        }
        let mut d = self.residual.clone();
        self.solver.precondition(&mut d);
        problem.dofs().max_position_change(&d)
    }

    /// Origin of the current factor; `None` when the factor cannot be recomputed.
    pub(super) fn factor_state(&self) -> Option<FactorState> {
        if !self.solver.can_be_restored() {
            return None;
        }
        let without_compliance = |origin| FactorState { origin, known_compliance: Vec::new() };
        if !self.solver.is_usable() {
            return Some(without_compliance(FactorOrigin::Nothing));
        }
        if let Some(inverses) = self.solver.vertices() {
            let rows = inverses.iter().map(|m| m.transpose().as_slice().try_into().unwrap_or_default());
            return Some(without_compliance(FactorOrigin::Vertices(rows.collect())));
        }
        let origin = match &self.factored {
            None => FactorOrigin::Rest,
            Some(AssemblyState { x, curvature, springs }) => FactorOrigin::State {
                x: numbers(x),
                projected: *curvature == Curvature::Projected,
                springs: springs.numbers(),
            },
        };
        let known = self.solver.known_compliance().map(|known| known.groups().to_vec());
        Some(FactorState { origin, known_compliance: known.unwrap_or_default() })
    }

    /// Recomputes a factor and the compliance of the `known` nodes.
    pub(super) fn restore_factor(
        &mut self,
        problem: &Problem,
        origin: &FactorOrigin,
        known: &[Vec<u32>],
    ) -> Option<()> {
        match origin {
            FactorOrigin::Rest => {}
            FactorOrigin::Nothing => self.solver.refresh(),
            FactorOrigin::Vertices(inverses) => {
                if inverses.len() != problem.dofs().n_unknown() {
                    return None;
                }
                self.solver.set_vertices(inverses.iter().map(|rows| Matrix3::from_row_slice(rows)).collect())?;
            }
            FactorOrigin::State { x, projected, springs } => {
                let curvature = if *projected { Curvature::Projected } else { Curvature::Exact };
                if springs.len() != problem.spring_points().len() {
                    return None;
                }
                self.tangent(problem, &vectors(x), curvature, Bend::Known(SpringBlocks::of_numbers(springs))).ok()?;
                self.solver.refresh();
                self.prepare(problem);
                if !self.solver.is_usable() {
                    return None;
                }
            }
        }
        known.iter().try_for_each(|group| self.solver.compliance(group.iter().copied()).map(|_| ()))
    }
}
