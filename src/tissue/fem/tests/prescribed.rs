//! Prescribed displacements of nodes that are held along all axes.

use super::blocks::{Slab, attach};
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, Locking, Model, SolveError, SolveSettings, Solver};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, Vector};

/// Stretch along z above the middle of the block.
const STRETCH: f64 = 1.2;

/// A block of 6 mm whose nodes from 3 mm up are held along all axes.
fn block() -> (MixedMesh, Vec<u8>) {
    let mut mesh = Slab { cells: [2, 2, 4], origin: [0.0; 3], size: [4.0, 4.0, 6.0], skin: 0.0 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(Attachment::Tied(1)));
    let held_axes = mesh.positions.iter().map(|p| if p.z >= 3.0 { 7 } else { 0 }).collect();
    (mesh, held_axes)
}

fn solver<'a>(
    mesh: &'a MixedMesh,
    held_axes: Vec<u8>,
    stretch: f64,
    locking: Locking,
    control: &Control,
) -> Solver<'a> {
    let moved = |p: &Point| Vector::new(0.0, 0.0, (stretch - 1.0) * (p.z - 3.0).max(0.0));
    let prescribed_mm = mesh.positions.iter().map(moved).collect();
    let boundary = Boundary { held_axes, prescribed_mm, ..Boundary::default() };
    let materials = Materials::homogeneous(Material::neo_hookean(0.02, 0.4));
    let settings = SolveSettings { locking, ..SolveSettings::new(Model::Nonlinear, materials) };
    Solver::with_boundary(mesh, Vec::new(), &boundary, settings, control).unwrap()
}

/// All nodes of the upper cells are held, and those above 3 mm are moved: the cells are stretched, not at rest.
#[test]
fn cells_whose_nodes_are_all_moved_have_stress_and_volume_ratio() {
    let control = Control::new();
    let (mesh, held_axes) = block();
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        let mut solver = solver(&mesh, held_axes.clone(), STRETCH, locking, &control);
        let report = solver.advance(1.0, &|_| Vec::new(), &control).unwrap();
        assert!(report.outcome.converged());
        let (cells, _) = solver.cell_states();
        let mut upper = 0;
        for (cell, state) in mesh.tetrahedra.iter().zip(cells) {
            if cell.iter().all(|n| mesh.positions[*n as usize].z >= 3.0) {
                upper += 1;
                assert!((state.volume_ratio - STRETCH).abs() < 1e-12, "{locking:?}: {state:?}");
                assert!(state.stress_mpa[2] > 1e-3, "{locking:?}: {state:?}");
            }
        }
        assert_eq!(upper, mesh.tetrahedra.len() / 2);
    }
}

/// Displacements that turn held cells inside out are refused, and compressed ones count in the smallest det F.
#[test]
fn cells_whose_nodes_are_all_moved_are_checked_for_inversion() {
    let control = Control::new();
    let (mesh, held_axes) = block();
    let mut squeezed = solver(&mesh, held_axes.clone(), 0.6, Locking::None, &control);
    let report = squeezed.advance(1.0, &|_| Vec::new(), &control).unwrap();
    assert!((report.min_det_f - 0.6).abs() < 1e-12, "{report:?}");
    let mut inverted = solver(&mesh, held_axes, -0.5, Locking::None, &control);
    let found = inverted.advance(1.0, &|_| Vec::new(), &control);
    assert!(matches!(found, Err(SolveError::Inverted { .. })), "{found:?}");
}
