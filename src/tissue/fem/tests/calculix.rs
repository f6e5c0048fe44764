//! Comparison with CalculiX on the same mesh.

use super::blocks::{Slab, attach};
use crate::fem::material::{Material, Materials, Volumetric};
use crate::fem::{Model, SkinElement, SolveSettings, Solver};
use crate::mesh::Attachment;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

const REFERENCE: &str = include_str!("../../../../tests/data/nh_nu30_5mm.txt");

#[test]
fn a_layered_slab_deforms_as_in_calculix() {
    let mut mesh =
        Slab { cells: [16, 16, 4], origin: [-60.0, -60.0, 0.0], size: [120.0, 120.0, 15.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let r = p.x.abs().max(p.y.abs());
        match p.z == 0.0 {
            true if r <= 20.5 => Some(Attachment::Tied(1)),
            true if r >= 30.0 => Some(Attachment::Fixed),
            _ => (r > 60.0 - 1e-6).then_some(Attachment::Fixed),
        }
    });
    // The volumetric energy of the reference.
    let of = |shear: f64| Material::neo_hookean(shear, 0.3).with_volumetric(Volumetric::Quadratic);
    let (skin, fat) = (of(0.070142923), of(0.011776447));
    let materials = Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat };
    let settings = SolveSettings {
        skin_element: SkinElement::Wedge,
        relative_residual: 1e-8,
        ..SolveSettings::new(Model::Nonlinear, materials)
    };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
    let push = |t: f64| vec![(1, Motion::translation(2.0 * t, t, 5.0 * t))];
    let report = solver.advance(1.0, &push, &control).unwrap();
    assert!(report.outcome.converged() && report.min_det_f > 0.0, "{report:?}");
    let expected = REFERENCE.lines().filter(|l| !l.starts_with('#')).map(|line| {
        let u: Vec<f64> = line.split(' ').map(|n| 1e-7 * n.parse::<f64>().unwrap()).collect();
        Vector::new(u[0], u[1], u[2])
    });
    let moved = solver.positions();
    let mut worst = 0.0f64;
    let mut count = 0;
    for ((now, rest), expected) in moved.iter().zip(&mesh.positions).zip(expected) {
        worst = worst.max((now - rest - expected).norm());
        count += 1;
    }
    assert_eq!(count, mesh.positions.len());
    // The reference was converged to 1e-8 relative and is written with 1e-7 mm.
    assert!(worst < 1e-5, "largest difference {worst:.2e} mm; {report:?}");
    for r in solver.iterations() {
        eprintln!("{r:?}");
    }
}
