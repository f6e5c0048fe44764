//! Two lips pressed on each other and aside, against CalculiX's surface contact on the same mesh.

use super::blocks::Slab;
use super::two_blocks::{Pair, overlap_mm};
use crate::fem::material::{Material, Materials, Volumetric};
use crate::fem::{Model, SolveSettings, Solver};
use crate::mesh::Attachment;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

/// Written by `two_lips.py` beside it.
const REFERENCE: &str = include_str!("../../../../tests/data/two_lips.txt");

#[test]
fn two_lips_move_as_in_calculix() {
    let mut pair = Pair::new(
        Slab { cells: [8, 4, 3], origin: [0.0; 3], size: [24.0, 10.0, 8.0], skin: 0.0 },
        Slab { cells: [6, 3, 3], origin: [5.0, 0.5, 8.0], size: [14.0, 9.0, 8.0], skin: 0.0 },
    );
    for (p, a) in pair.mesh.positions.iter().zip(&mut pair.mesh.attachment) {
        if p.z < 1e-9 {
            *a = Attachment::Fixed;
        } else if p.z > 16.0 - 1e-9 {
            *a = Attachment::Tied(1);
        }
    }
    pair.round(0.6);
    let material = Material::neo_hookean(0.011776447, 0.3).with_volumetric(Volumetric::Quadratic);
    let settings = SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material));
    let control = Control::new();
    let mut solver = Solver::new(&pair.mesh, vec![], settings, &control).unwrap();
    let path = |t: f64| vec![(1, Motion::translation(2.0 * t, t, -3.0 * t))];
    let report = solver.advance(1.0, &path, &control).unwrap();
    let numbers = |line: &str| line.split(' ').filter_map(|n| n.parse::<f64>().ok()).collect::<Vec<f64>>();
    let (comments, lines): (Vec<&str>, Vec<&str>) = REFERENCE.lines().partition(|l| l.starts_with('#'));
    let expected: Vec<Vector> = lines.iter().map(|l| 1e-6 * Vector::from_column_slice(&numbers(l))).collect();
    assert_eq!(expected.len(), pair.mesh.positions.len());
    let moved = solver.positions();
    let off = moved.iter().zip(&pair.mesh.positions).zip(&expected).map(|((now, rest), u)| (now - rest - u).norm());
    let (worst, mean) = (off.clone().fold(0.0, f64::max), off.sum::<f64>() / moved.len() as f64);
    // The force on the fixed nodes is that on the upper lip, reversed.
    let force = numbers(comments[1]);
    let reaction = report.reactions_n[0].1;
    let overlap = overlap_mm(&pair.mesh, &moved, 12);
    println!(
        "two lips: worst {worst:.4} mm, mean {mean:.5} mm, force {reaction:.4?} N, CalculiX {force:.4?} N, {report:?}"
    );
    assert!(worst < 0.05 && overlap <= 0.05, "{worst} {overlap}");
    assert!((-reaction[2] / force[2] - 1.0).abs() < 0.02, "{reaction:?} {force:?}");
}
