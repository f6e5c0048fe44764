//! What does not change along a path: elements with their laws, unknowns, loads and tolerances.

use super::assembly::{Assembly, Pattern};
use super::dofs::Dofs;
use super::springs::SpringPoint;
use prosopon_geometry::Vector;
use prosopon_geometry::control::Clock;
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
    /// Diagonal of the box around the mesh at rest, mm.
    pub(super) mesh_size_mm: f64,
    /// Round-off error of the energy at rest, mJ: scales with shear modulus times volume.
    pub(super) energy_noise_mj: f64,
    /// Whether the forces are linear in the displacements.
    pub(super) linear: bool,
    /// Pull at which gliding tissue comes off bone, MPa.
    pub(super) pull_off_mpa: Option<f64>,
}

/// Elements, unknowns, loads and tolerances. Only [`Problem::stabilise`] changes them, between two substeps.
#[derive(Debug)]
pub(super) struct Problem {
    dofs: Dofs,
    assembly: Assembly,
    /// Stiffness of the elements at rest; empty when unknown.
    rest_stiffness: Arc<Vec<f64>>,
    /// Dead loads at path parameter 1, by mesh node; empty when there are none.
    loads: Vec<Vector>,
    springs: Arc<Vec<SpringPoint>>,
    limits: Limits,
    clock: Clock,
}

impl Problem {
    pub(super) fn new(
        dofs: Dofs,
        assembly: Assembly,
        rest_stiffness: Arc<Vec<f64>>,
        loads: Vec<Vector>,
        springs: Arc<Vec<SpringPoint>>,
        limits: Limits,
        clock: Clock,
    ) -> Self {
        Self { dofs, assembly, rest_stiffness, loads, springs, limits, clock }
    }

    pub(super) fn dofs(&self) -> &Dofs {
        &self.dofs
    }

    pub(super) fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    pub(super) fn pattern(&self) -> &Pattern {
        self.assembly.pattern()
    }

    /// Nodes with springs.
    pub(super) fn spring_points(&self) -> &[SpringPoint] {
        &self.springs
    }

    pub(super) fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Time of the caller's clock, s.
    pub(super) fn now(&self) -> f64 {
        (self.clock)()
    }

    /// Replaces materials that can lose ellipticity by stable ones. Returns whether there were any.
    pub(super) fn stabilise(&mut self) -> bool {
        let changed = self.assembly.stabilise();
        if changed {
            self.rest_stiffness = Arc::default();
        }
        changed
    }

    /// Stiffness of the elements at `x`, when that is rest and its stiffness is known.
    pub(super) fn known_stiffness(&self, x: &[Vector]) -> Option<&[f64]> {
        (!self.rest_stiffness.is_empty() && x == self.dofs.rest()).then_some(self.rest_stiffness.as_slice())
    }

    /// Work of a share of the dead loads from rest to `x`, mJ.
    pub(super) fn work_of_loads(&self, x: &[Vector], load_share: f64) -> f64 {
        let moved = x.iter().zip(self.dofs.rest());
        load_share * self.loads.iter().zip(moved).map(|(f, (x, rest))| f.dot(&(x - rest))).sum::<f64>()
    }

    /// Subtracts a share of the dead loads from the gradient of the energy.
    pub(super) fn subtract_loads(&self, gradient: &mut [Vector], load_share: f64) {
        gradient.iter_mut().zip(&self.loads).for_each(|(g, f)| *g -= f * load_share);
    }

    /// Sum of squares of a share of the dead loads, N².
    pub(super) fn squared_loads(&self, load_share: f64) -> f64 {
        self.loads.iter().map(|f| (f * load_share).norm_squared()).sum::<f64>()
    }

    /// Factor that makes the generalised force on a node comparable with a force in N.
    pub(super) fn force_unit(&self, node: usize) -> f64 {
        if self.dofs.is_position(node) { 1.0 } else { 1.0 / self.limits.element_size_mm }
    }
}
