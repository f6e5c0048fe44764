//! Comparison with closed forms, without contact.

use super::blocks::{Slab, attach};
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, Locking, Model, Preset, SkinElement, SolveSettings, Solver};
use crate::mesh::{Attachment, MixedMesh, Tissue};
use nalgebra::{Matrix3, UnitQuaternion};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};

fn is_on_box(p: &Point, size: f64) -> bool {
    p.iter().any(|c| *c < 1e-9 || *c > size - 1e-9)
}

/// A cube of edge 3 mm with displaced inner nodes; every boundary node is its own segment.
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
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        uniaxial_tension(locking);
    }
}

fn uniaxial_tension(locking: Locking) {
    let mesh = crooked_cube();
    let (mu, nu) = (0.02, 0.45);
    let bulk = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    let material = Material::neo_hookean(mu, nu);
    // Stresses of mu/2 (J^(-2/3) I1 - 3) + K/4 (J² - 1 - 2 ln J) under diag(l, a, a).
    let stress = |l: f64, a: f64| {
        let (i1, j) = (l * l + 2.0 * a * a, l * a * a);
        let s = mu * j.powf(-2.0 / 3.0);
        let pressure = 0.5 * bulk * (j - 1.0 / j);
        (s * (l - i1 / (3.0 * l)) + pressure * a * a, s * (a - i1 / (3.0 * a)) + pressure * l * a)
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
        locking,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material))
    };
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
        let energy = solver.equations.problem.assembly().energy(&solver.reached.x).unwrap();
        assert!(energy.abs() < 1e-9, "{energy}");
        // The outer surface rotates too.
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
    // The error ratio e(k+1) / e(k)² stays bounded once e < 0.1, until rounding dominates.
    let tail: Vec<f64> = relative.into_iter().filter(|r| *r > 1e-12).collect();
    for pair in tail.windows(2).filter(|p| p[0] < 0.1) {
        assert!(pair[1] < 3.0 * pair[0] * pair[0] + 1e-11, "{tail:?}");
    }
}

/// Three planes of symmetry, and a dead traction on the face x = 3 or its displacement along x: stress and stretch of uniaxial
/// tension.
#[test]
fn a_cube_on_planes_of_symmetry_stretches_by_load_and_by_displacement_as_in_closed_form() {
    let mut mesh = crooked_cube();
    mesh.attachment.fill(Attachment::Free);
    let (mu, nu) = (0.02, 0.3);
    let bulk = 2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    let stretch = Vector::new(1.4, 0.86, 0.86);
    let nominal = |s: &Vector, axis: usize| {
        let (i1, j) = (s.norm_squared(), s.product());
        mu * j.powf(-2.0 / 3.0) * (s[axis] - i1 / (3.0 * s[axis])) + 0.5 * bulk * (j * j - 1.0) / s[axis]
    };
    // The lateral stretch with stress-free sides.
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let mid = 0.5 * (low + high);
        if nominal(&Vector::new(stretch.x, mid, mid), 1) > 0.0 { high = mid } else { low = mid }
    }
    let stretch = Vector::new(stretch.x, low, low);
    let held_axes = mesh.positions.iter().map(|p| (0..3).filter(|&a| p[a] == 0.0).fold(0, |bits, a| bits | 1 << a));
    let mut boundary = Boundary {
        held_axes: held_axes.collect(),
        loads_n: vec![Vector::zeros(); mesh.positions.len()],
        ..Boundary::default()
    };
    for [a, b, c, d] in &mesh.tetrahedra {
        for face in [[a, c, b], [a, b, d], [a, d, c], [b, c, d]] {
            let x = face.map(|n| mesh.positions[*n as usize]);
            if x.iter().all(|p| p.x == 3.0) {
                let area = 0.5 * (x[1] - x[0]).cross(&(x[2] - x[0])).norm();
                face.iter().for_each(|n| boundary.loads_n[**n as usize].x += area / 3.0 * nominal(&stretch, 0));
            }
        }
    }
    let mut displaced = Boundary {
        prescribed_mm: vec![Vector::zeros(); mesh.positions.len()],
        loads_n: Vec::new(),
        ..boundary.clone()
    };
    for (node, _) in mesh.positions.iter().enumerate().filter(|(_, p)| p.x == 3.0) {
        displaced.held_axes[node] |= 1;
        displaced.prescribed_mm[node].x = 3.0 * (stretch.x - 1.0);
    }
    let cases = [Locking::None, Locking::Smoothed, Locking::Patched]
        .into_iter()
        .flat_map(|l| [(l, &boundary), (l, &displaced)]);
    for (locking, boundary) in cases {
        let settings = SolveSettings {
            relative_residual: 1e-10,
            locking,
            ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(Material::neo_hookean(mu, nu)))
        };
        let control = Control::new();
        let mut solver = Solver::with_boundary(&mesh, vec![], boundary, settings, &control).unwrap();
        solver.advance(1.0, &|_| Vec::new(), &control).unwrap();
        for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
            assert!((now.coords - rest.coords.component_mul(&stretch)).norm() < 1e-8, "{locking:?} {now} {rest}");
        }
        let (cells, _) = solver.cell_states();
        let cauchy = nominal(&stretch, 0) / (stretch.y * stretch.z);
        for cell in cells {
            assert!((cell.volume_ratio - stretch.product()).abs() < 1e-8);
            assert!((cell.stress_mpa[0] - cauchy).abs() < 1e-8 * cauchy);
            assert!(cell.stress_mpa[1..].iter().all(|s| s.abs() < 1e-8 * cauchy), "{cell:?}");
        }
    }
}

#[test]
fn a_body_that_can_slide_along_its_planes_of_symmetry_is_refused() {
    let mut mesh = crooked_cube();
    mesh.attachment.fill(Attachment::Free);
    let held_axes = mesh.positions.iter().map(|p| u8::from(p.x == 0.0) + 2 * u8::from(p.y == 0.0)).collect();
    let boundary = Boundary { held_axes, ..Boundary::default() };
    let settings = SolveSettings::new(Model::Nonlinear, Preset::Wang2009Stable.materials());
    let error = Solver::with_boundary(&mesh, vec![], &boundary, settings, &Control::new()).unwrap_err();
    assert!(error.to_string().contains("can move freely"), "{error}");
}

#[test]
fn relaxed_mass_tensors_come_to_rest_where_the_linear_model_does() {
    let mut mesh = Slab { cells: [8, 8, 3], origin: [0.0; 3], size: [24.0, 24.0, 9.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(if p.x > 12.0 { Attachment::Tied(1) } else { Attachment::Tied(0) }));
    let control = Control::new();
    let path = |t: f64| vec![(1, Motion::translation(0.0, -2.0 * t, 5.0 * t))];
    let solve = |model: Model| {
        let settings =
            SolveSettings { relative_residual: 1e-9, ..SolveSettings::new(model, Preset::Wang2009Stable.materials()) };
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let report = solver.advance(1.0, &path, &control).unwrap();
        (solver.positions(), report.factorisations)
    };
    let (linear, one) = solve(Model::Linear);
    let (relaxed, none) = solve(Model::MassTensor);
    assert_eq!((one, none), (1, 0));
    let worst = linear.iter().zip(&relaxed).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(worst < 1e-6 * 5.4, "{worst:.2e} mm");
}

/// Lengths times 0.1 or 1000 and moduli in other units give the same shape.
#[test]
fn the_answer_has_no_units() {
    let control = Control::new();
    let solve = |length: f64, modulus: f64, locking: Locking| {
        let size = [24.0, 24.0, 8.0].map(|s| s * length);
        let mut mesh = Slab { cells: [6, 6, 2], origin: [0.0; 3], size, skin: 1.5 * length }.mesh();
        let middle = 12.0 * length;
        attach(&mut mesh, |p| {
            (p.z == 0.0).then_some(if p.x > middle { Attachment::Tied(1) } else { Attachment::Tied(0) })
        });
        let material = |shear: f64| Material::neo_hookean(shear * modulus, 0.45);
        let (skin, fat) = (material(0.07), material(0.012));
        let materials = Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat };
        let settings =
            SolveSettings { relative_residual: 1e-9, locking, ..SolveSettings::new(Model::Nonlinear, materials) };
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let push = |t: f64| vec![(1, Motion::translation(0.0, length * t, 3.0 * length * t))];
        solver.advance(1.0, &push, &control).unwrap();
        let moved = solver.positions();
        moved.iter().zip(&mesh.positions).map(|(a, b)| (a - b) / length).collect::<Vec<_>>()
    };
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        let reference = solve(1.0, 1.0, locking);
        for (length, modulus) in [(0.1, 1.0), (1000.0, 1.0), (1.0, 1000.0)] {
            let scaled = solve(length, modulus, locking);
            let worst = reference.iter().zip(&scaled).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(worst < 1e-7 * 3.0, "{length} {modulus} {locking:?}: {worst:.1e}");
        }
    }
}

/// A bar between three planes of symmetry that meet in a corner of its C1 surface, pulled by a dead load: the deformation is
/// homogeneous, with stress-free sides. The tangents at that corner must be free to grow with it. The quadrature's patch test
/// holds to 2e-8.
#[test]
fn a_bar_of_c1_prisms_between_three_planes_of_symmetry_stays_homogeneous() {
    let size = [8.0, 6.0, 5.0];
    let mesh = Slab { cells: [3, 2, 2], origin: [0.0; 3], size, skin: 1.5 }.mesh();
    let top = size[2] + 1.5;
    let held = |p: &Point| u8::from(p.x == 0.0) + 2 * u8::from(p.y == 0.0) + 4 * u8::from((p.z - top).abs() < 1e-9);
    let material = Material::neo_hookean(0.01, 0.45);
    // Nominal stress at the stretch 1.2, and the transverse stretch by bisection.
    let stress =
        |across: f64| material.first_piola(&Matrix3::from_diagonal(&Vector::new(across, across, 1.2))).unwrap();
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if stress(middle)[(0, 0)] > 0.0 { high = middle } else { low = middle }
    }
    let pull = stress(low)[(2, 2)];
    let mut loads_n = vec![Vector::zeros(); mesh.positions.len()];
    for face in &mesh.bone_faces {
        let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
        let third = 0.5 * (b - a).cross(&(c - a)).norm() / 3.0;
        face.iter().for_each(|n| loads_n[*n as usize] -= Vector::z() * (pull * third));
    }
    let boundary = Boundary { held_axes: mesh.positions.iter().map(held).collect(), loads_n, ..Boundary::default() };
    let settings = SolveSettings {
        relative_residual: 1e-10,
        ..SolveSettings::new(Model::Mixed, Materials::homogeneous(material))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, vec![], &boundary, settings, &control).unwrap();
    solver.advance(1.0, &|_| Vec::new(), &control).unwrap();
    for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
        let exact = Point::new(low * rest.x, low * rest.y, top + 1.2 * (rest.z - top));
        assert!((now - exact).norm() < 1e-6, "{rest} {now} {exact}");
    }
}
