//! Against closed forms, without contact.

use super::blocks::{Slab, attach};
use crate::control::Control;
use crate::fem::material::{Material, Materials};
use crate::fem::{Model, Preset, SkinElement, SolveSettings, Solver};
use crate::geometry::{Motion, Point, Vector};
use crate::mesh::{Attachment, MixedMesh, Tissue};
use nalgebra::{Matrix3, UnitQuaternion};

fn is_on_box(p: &Point, size: f64) -> bool {
    p.iter().any(|c| *c < 1e-9 || *c > size - 1e-9)
}

/// A cube of edge 3 mm with crooked inner nodes; every boundary node is its own segment.
fn crooked_cube() -> MixedMesh {
    let mut mesh = Slab { cells: [3, 3, 3], origin: [0.0; 3], size: [3.0; 3], skin: 0.0 }.mesh();
    for (i, p) in mesh.positions.iter_mut().enumerate() {
        if is_on_box(p, 3.0) {
            mesh.attachment[i] = Attachment::Tied(i as u32);
        } else {
            let i = i as f64;
            *p += Vector::new((3.0 * i).sin(), (5.0 * i).sin(), (7.0 * i).sin()) * 0.15;
        }
    }
    mesh
}

#[test]
fn uniaxial_tension_of_a_crooked_cube_is_homogeneous_with_the_closed_form_stress() {
    let mesh = crooked_cube();
    let (mu, nu) = (0.02, 0.45);
    let bulk = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    let material = Material::neo_hookean(mu, nu);
    // Stresses of mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)² under diag(l, a, a).
    let stress = |l: f64, a: f64| {
        let (i1, j) = (l * l + 2.0 * a * a, l * a * a);
        let s = mu * j.powf(-2.0 / 3.0);
        (s * (l - i1 / (3.0 * l)) + bulk * (j - 1.0) * a * a, s * (a - i1 / (3.0 * a)) + bulk * (j - 1.0) * l * a)
    };
    let l = 1.5;
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let mid = 0.5 * (low + high);
        if stress(l, mid).1 > 0.0 { high = mid } else { low = mid }
    }
    let f = Matrix3::from_diagonal(&Vector::new(l, low, low));
    let settings = SolveSettings {
        relative_residual: 1e-10,
        ..SolveSettings::new(Model::Mixed, Materials::homogeneous(material))
    };
    let settings = SolveSettings { skin_element: SkinElement::Wedge, ..settings };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
    let path = |t: f64| {
        let tied = mesh.positions.iter().enumerate().filter(|(_, p)| is_on_box(p, 3.0));
        tied.map(|(i, p)| (i as u32, Motion::from((f - Matrix3::identity()) * p.coords * t))).collect()
    };
    let report = solver.advance(1.0, &path, &control).unwrap();
    for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
        assert!((now.coords - f * rest.coords).norm() < 1e-8);
    }
    let total = |axis: usize| -> f64 {
        let pulled = report.reactions_n.iter().filter(|(s, _)| mesh.positions[*s as usize][axis] > 3.0 - 1e-9);
        pulled.map(|(_, force)| force[axis]).sum()
    };
    assert!((total(0) - 9.0 * stress(l, low).0).abs() < 1e-9);
    assert!(total(1).abs() < 1e-9 && total(2).abs() < 1e-9);
    assert!((report.min_det_f - f.determinant()).abs() < 1e-9);
}

#[test]
fn turning_the_whole_boundary_by_90_degrees_costs_no_energy() {
    for skin_element in [SkinElement::Wedge, SkinElement::C1Prism] {
        let mut mesh = Slab { cells: [3, 3, 2], origin: [0.0; 3], size: [6.0, 6.0, 4.5], skin: 1.5 }.mesh();
        attach(&mut mesh, |p| is_on_box(p, 6.0).then_some(Attachment::Tied(1)));
        // One material: with several, the linear prediction of a large rotation is not exact.
        let materials = Materials::homogeneous(Material::neo_hookean(0.02, 0.45));
        let settings = SolveSettings { skin_element, ..SolveSettings::new(Model::Mixed, materials) };
        let control = Control::new();
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let turn = |t: f64| {
            let q = UnitQuaternion::from_axis_angle(&Vector::y_axis(), t * std::f64::consts::FRAC_PI_2);
            vec![(1, Motion::from_parts(Vector::new(1.0, 2.0, 3.0).into(), q))]
        };
        let report = solver.advance(1.0, &turn, &control).unwrap();
        assert_eq!(report.substeps, 1, "{skin_element:?} {report:?} {:#?}", solver.iterations());
        let motion = turn(1.0)[0].1;
        for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
            assert!((now - motion * rest).norm() < 1e-4, "{}", (now - motion * rest).norm());
        }
        let energy = solver.equations.assembly.energy(&solver.state.x).unwrap();
        assert!(energy.abs() < 1e-9, "{energy}");
        // The outer surface turns too.
        let p = mesh.prisms[0].map(|n| mesh.positions[n as usize]);
        let rest = Point::from((p[0].coords + p[1].coords + p[2].coords) / 3.0);
        let moved = solver.outer_displacement(0, [1.0 / 3.0; 3]);
        assert!((moved - (motion * rest - rest)).norm() < 1e-4);
    }
}

#[test]
fn the_small_strain_model_is_the_limit_of_the_nonlinear_one_and_proportional() {
    let mut mesh = Slab { cells: [6, 6, 2], origin: [0.0; 3], size: [24.0, 24.0, 8.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(if p.x > 12.0 { Attachment::Tied(1) } else { Attachment::Tied(0) }));
    mesh.tetrahedron_tissue.iter_mut().step_by(3).for_each(|t| *t = Tissue::Muscle);
    let control = Control::new();
    let path = |t: f64| vec![(1, Motion::translation(0.3 * t, -0.2 * t, t))];
    let solve = |model: Model, t: &[f64]| {
        let settings = SolveSettings {
            skin_element: SkinElement::Wedge,
            relative_residual: 1e-9,
            ..SolveSettings::new(model, Preset::Wang2009Stable.materials())
        };
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let factorisations: usize = t.iter().map(|t| solver.advance(*t, &path, &control).unwrap().factorisations).sum();
        let u: Vec<Vector> = solver.positions().iter().zip(&mesh.positions).map(|(a, b)| a - b).collect();
        (u, factorisations)
    };
    let small = 1e-4;
    let (linear, _) = solve(Model::Linear, &[small]);
    let (nonlinear, _) = solve(Model::Mixed, &[small]);
    // The difference is of second order in the strain (some 3e-5).
    for (a, b) in linear.iter().zip(&nonlinear) {
        assert!((a - b).norm() < 1e-4 * small, "{}", (a - b).norm() / small);
    }
    let (large, factorisations) = solve(Model::Linear, &[1.0, 2.0, 3.0]);
    assert_eq!(factorisations, 1);
    for (a, b) in linear.iter().zip(&large) {
        assert!((a * 3.0 / small - b).norm() < 1e-6);
    }
}

#[test]
fn newton_converges_quadratically() {
    let mut mesh = Slab { cells: [6, 6, 2], origin: [0.0; 3], size: [24.0, 24.0, 8.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(if p.x > 12.0 { Attachment::Tied(1) } else { Attachment::Tied(0) }));
    let settings = SolveSettings {
        relative_residual: 1e-11,
        ..SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials())
    };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
    solver.advance(1.0, &|t| vec![(1, Motion::translation(0.0, t, 2.0 * t))], &control).unwrap();
    let relative: Vec<f64> = solver.iterations().iter().map(|r| r.residual_n / r.reaction_n).collect();
    assert!(relative.len() >= 3);
    // Error ratio e(k+1) / e(k)² stays bounded once e < 0.1; down to where round-off begins.
    let tail: Vec<f64> = relative.into_iter().filter(|r| *r > 1e-12).collect();
    for pair in tail.windows(2).filter(|p| p[0] < 0.1) {
        assert!(pair[1] < 3.0 * pair[0] * pair[0] + 1e-11, "{tail:?}");
    }
}
