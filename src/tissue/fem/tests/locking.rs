//! Cook's membrane in three dimensions, against independent solvers.

use super::blocks::{Slab, attach};
use crate::fem::material::{Material, Materials, Volumetric};
use crate::fem::{Boundary, Locking, Model, SolveSettings, Solver};
use crate::mesh::Attachment;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};

/// Shear modulus and traction of the reference, MPa.
const SHEAR: f64 = 11.776447e-3;
const TRACTION: f64 = 6.25 * SHEAR / 80.1938;

/// Vertical displacement of the tip, mm, of half a membrane 10 mm thick with 16 x 16 x 3 cells.
fn tip(poisson: f64, locking: Locking) -> f64 {
    let mut mesh = Slab { cells: [16, 16, 3], origin: [0.0; 3], size: [1.0, 1.0, 5.0], skin: 0.0 }.mesh();
    for p in &mut mesh.positions {
        *p = Point::new(48.0 * p.x, 44.0 * p.x + p.y * (44.0 - 28.0 * p.x), p.z);
    }
    let held = |p: &Point| if p.x == 0.0 { 7 } else { 4 * u8::from(p.z == 0.0) };
    let mut loads_n = vec![Vector::zeros(); mesh.positions.len()];
    for [a, b, c, d] in &mesh.tetrahedra {
        for face in [[a, c, b], [a, b, d], [a, d, c], [b, c, d]] {
            let x = face.map(|n| mesh.positions[*n as usize]);
            if x.iter().all(|p| p.x == 48.0) {
                let area = 0.5 * (x[1] - x[0]).cross(&(x[2] - x[0])).norm();
                face.iter().for_each(|n| loads_n[**n as usize].y += TRACTION * area / 3.0);
            }
        }
    }
    let boundary = Boundary { held_axes: mesh.positions.iter().map(held).collect(), loads_n, ..Boundary::default() };
    // The volumetric energy of the references.
    let material = Material::neo_hookean(SHEAR, poisson).with_volumetric(Volumetric::Quadratic);
    let settings = SolveSettings {
        relative_residual: 1e-6,
        locking,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, vec![], &boundary, settings, &control).unwrap();
    for step in 1..=4 {
        solver.advance(0.25 * f64::from(step), &|_| Vec::new(), &control).unwrap();
    }
    let node = mesh.positions.iter().position(|p| *p == Point::new(48.0, 60.0, 0.0)).unwrap();
    solver.positions()[node].y - 60.0
}

#[test]
fn cooks_membrane_does_not_lock_with_patches() {
    // Poisson ratio, least displacement, converged value.
    for (poisson, least, converged) in
        [(0.45, 8.3, 8.570), (0.49, 8.15, 8.39), (0.499, 8.0, 8.355), (0.4999, 8.0, 8.36)]
    {
        let found = tip(poisson, Locking::Patched);
        println!("{poisson}: {found:.3}");
        assert!(found > least && found < converged, "{poisson}: {found}");
    }
}

#[test]
fn cooks_membrane_bends_as_in_other_solvers_and_does_not_lock_when_smoothed() {
    // Poisson ratio; standard tetrahedra of another program on the same mesh; averaged nodal pressure on it; converged value.
    for (poisson, plain, averaged, converged) in [(0.45, 6.82237, 8.03, 8.570), (0.499, 2.73119, 7.62, 8.355)] {
        let found = tip(poisson, Locking::None);
        // That program stopped at an increment of 1e-7 mm.
        assert!((found - plain).abs() < 1e-4, "plain: {found}, expected {plain}");
        let smoothed = tip(poisson, Locking::Smoothed);
        assert!(smoothed > averaged && smoothed < converged, "smoothed: {smoothed}");
    }
}

/// Share of a path in steps of a tenth that is solved: one end of a block is fixed, the other one follows `motion`.
fn reached(slab: Slab, material: Material, locking: Locking, motion: &dyn Fn(f64) -> Motion) -> f64 {
    let mut mesh = slab.mesh();
    let length = slab.size[0];
    attach(&mut mesh, |p| match p.x {
        0.0 => Some(Attachment::Fixed),
        x if x == length => Some(Attachment::Tied(1)),
        _ => None,
    });
    let settings = SolveSettings { locking, ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material)) };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
    let solved = |step: &i32| {
        let report = solver.advance(0.1 * f64::from(*step), &|t| vec![(1, motion(t))], &control);
        report.is_ok_and(|report| report.outcome.converged())
    };
    0.1 * (1..=10).take_while(solved).count() as f64
}

/// Averages do not see every mode of the elements; where such modes lose their stiffness, smoothed elements stop.
#[test]
fn patches_go_as_far_as_plain_elements_when_stretched_and_bent() {
    let bar = Slab { cells: [12, 4, 4], origin: [0.0; 3], size: [24.0, 8.0, 8.0], skin: 0.0 };
    let plate = Slab { cells: [20, 6, 2], origin: [0.0; 3], size: [30.0, 9.0, 1.5], skin: 0.0 };
    let stretched = |t: f64| Motion::translation(24.0 * t, 0.0, 0.0);
    // To a quarter of a circle of the plate's length.
    let bent = |t: f64| {
        let angle = (0.5 * std::f64::consts::PI * t).max(1e-9);
        let radius = 30.0 / angle;
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector::y_axis(), -angle);
        let end = Vector::new(radius * angle.sin(), 0.0, radius * (1.0 - angle.cos()));
        Motion::from_parts((end - turn * Vector::new(30.0, 0.0, 0.0)).into(), turn)
    };
    for poisson in [0.45, 0.49] {
        for material in [Material::neo_hookean(0.01, poisson), Material::ogden(0.01, 8.0, poisson)] {
            let shares = |slab: Slab, motion: &dyn Fn(f64) -> Motion| {
                [Locking::None, Locking::Smoothed, Locking::Patched].map(|l| reached(slab, material, l, motion))
            };
            for (name, found) in [("bar", shares(bar, &stretched)), ("plate", shares(plate, &bent))] {
                println!("{name}, {poisson}, {:?}: plain, smoothed, patched: {found:.1?}", material.isochoric);
                assert!(found[2] >= found[0], "{name}, {poisson}: {found:?}");
            }
        }
    }
}
