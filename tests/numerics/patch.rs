//! Patch tests: boundary nodes follow a linear field, and the others must reproduce it; a rigid rotation gives no stress.

use nalgebra::{Matrix3, Rotation3, Vector3};
use prosopon_tissue::fem::element::{self, C1Surface, ElementBlock, TriangleRule};
use prosopon_tissue::fem::material::Material;
use prosopon_tissue::mesh::MixedMesh;

use crate::dense::{self, deformation_gradient};
use crate::slab::Slab;

const RULES: [TriangleRule; 4] =
    [TriangleRule::Blended12, TriangleRule::Blended16, TriangleRule::Blended19, TriangleRule::Collapsed(6)];
const FAT: (f64, f64) = (0.0118, 0.45);

fn linear_map() -> Matrix3<f64> {
    Matrix3::new(1.15, 0.12, -0.08, 0.05, 0.92, 0.1, -0.06, 0.07, 1.04)
}

fn flat() -> Slab {
    Slab { cells: 3, layers: 2, distortion: 0.12, height: |_, _| 0.0 }
}

fn curved() -> Slab {
    Slab { cells: 3, layers: 2, distortion: 0.12, height: |x, y| 1.2 * (0.35 * x).sin() + 0.04 * (y - 6.0).powi(2) }
}

/// Largest error of the patch test relative to the largest displacement. Loads at the free nodes balance the stresses, integrated
/// with `blocks_for_loads` (a finer rule where the rule itself is tested).
fn patch_error(
    slab: &Slab,
    rest: &[Vector3<f64>],
    n_positions: usize,
    blocks: &[ElementBlock],
    blocks_for_loads: &[ElementBlock],
    tangents_held: &dyn Fn(usize) -> bool,
) -> f64 {
    let a = linear_map();
    let material = Material::neo_hookean(FAT.0, FAT.1);
    let exact: Vec<Vector3<f64>> = rest.iter().map(|x| a * x).collect();
    let stress = material.first_piola(&a).unwrap();
    let mut loads = vec![Vector3::zeros(); rest.len()];
    for block in blocks_for_loads {
        let n = block.n_functions;
        for (point, weight) in block.weights.iter().enumerate() {
            let e = point / block.n_points;
            for i in 0..n {
                loads[block.nodes[e * n + i] as usize] += stress * block.gradients[point * n + i] * *weight;
            }
        }
    }
    let free: Vec<usize> = (0..rest.len())
        .filter(
            |&node| if node < n_positions { !slab.held_and_skin(node).0 } else { !tangents_held(node - n_positions) },
        )
        .collect();
    for &node in &free {
        // Inner nodes carry no load.
        if node < n_positions && !slab.held_and_skin(node).1 {
            loads[node] = Vector3::zeros();
        }
    }
    let body: Vec<_> = blocks.iter().map(|b| (b, material)).collect();
    // Start with an error at the free nodes.
    let mut values = exact.clone();
    for &node in &free {
        values[node] +=
            Vector3::new((1.1 * node as f64).sin(), (2.3 * node as f64).cos(), (0.7 * node as f64).sin()) * 0.05;
    }
    dense::solve(&body, &mut values, &free, &loads);
    let size = exact.iter().zip(rest).map(|(x, r)| (x - r).norm()).fold(0.0, f64::max);
    values.iter().zip(&exact).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max) / size
}

fn positions(mesh: &MixedMesh) -> Vec<Vector3<f64>> {
    mesh.positions.iter().map(|p| p.coords).collect()
}

#[test]
fn tetrahedra_with_split_prisms_pass() {
    for slab in [flat(), curved()] {
        let mesh = slab.mesh();
        let [split, _] = element::prisms_as_tetrahedra(&mesh).unwrap();
        let blocks = [element::tetrahedra(&mesh).unwrap(), split];
        let error = patch_error(&slab, &positions(&mesh), mesh.positions.len(), &blocks, &blocks, &|_| true);
        assert!(error < 1e-11, "{error:e}");
    }
}

#[test]
fn wedges_over_tetrahedra_pass() {
    for slab in [flat(), curved()] {
        let mesh = slab.mesh();
        let blocks = [element::tetrahedra(&mesh).unwrap(), element::wedges(&mesh).unwrap()];
        let error = patch_error(&slab, &positions(&mesh), mesh.positions.len(), &blocks, &blocks, &|_| true);
        assert!(error < 1e-11, "{error:e}");
    }
}

/// Only the quadrature prevents the C1 prism from passing exactly; the bounds are the measured errors in `TriangleRule`'s table,
/// rounded up.
#[test]
fn c1_prisms_over_tetrahedra_pass_as_well_as_their_quadrature() {
    for (slab, bounds) in [(flat(), [1e-7, 1e-7, 1e-7, 1e-4]), (curved(), [1e-5, 1e-5, 1e-6, 1e-4])] {
        let mesh = slab.mesh();
        let n = mesh.positions.len();
        let fine = C1Surface::with_rule(&mesh, TriangleRule::Collapsed(24));
        assert_eq!(fine.warnings(), Vec::new());
        let rest = fine.rest_values(&mesh);
        let tetrahedra = element::tetrahedra(&mesh).unwrap();
        let loads = [tetrahedra.clone(), element::c1_prisms(&mesh, &fine).unwrap()];
        let held = |tangent: usize| slab.held_and_skin(fine.outer_nodes[tangent / 2] as usize).0;
        for (rule, bound) in RULES.into_iter().zip(bounds) {
            let surface = C1Surface { rule, ..fine.clone() };
            let blocks = [tetrahedra.clone(), element::c1_prisms(&mesh, &surface).unwrap()];
            let error = patch_error(&slab, &rest, n, &blocks, &loads, &held);
            println!("{rule:?}: {error:.1e}");
            assert!(error < bound, "{rule:?}: {error:e}");
        }
    }
}

#[test]
fn a_quarter_turn_gives_no_stress() {
    let material = Material::neo_hookean(1.0, 0.49);
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2).into_inner();
    let mesh = curved().mesh();
    let surface = C1Surface::new(&mesh);
    let values: Vec<_> = surface.rest_values(&mesh).iter().map(|x| turn * x).collect();
    let [split, _] = element::prisms_as_tetrahedra(&mesh).unwrap();
    for block in [
        element::tetrahedra(&mesh).unwrap(),
        element::wedges(&mesh).unwrap(),
        split,
        element::c1_prisms(&mesh, &surface).unwrap(),
    ] {
        for e in 0..block.n_elements() {
            for p in 0..block.n_points {
                let stress = material.first_piola(&deformation_gradient(&block, &values, e, p)).unwrap();
                // K is 50 times the shear modulus.
                assert!(stress.norm() < 1e-12 * material.bulk, "{}: {:e}", block.kind, stress.norm());
            }
        }
    }
}

/// Range of the eigenvalues of one prism's stiffness relative to the exactly integrated one, without rigid motions.
fn relative_spectrum(mesh: &MixedMesh, surface: &C1Surface, prism: usize, poisson: f64) -> (f64, f64) {
    let material = Material::neo_hookean(1.0, poisson);
    let single = MixedMesh { prisms: vec![mesh.prisms[prism]], ..mesh.clone() };
    let rest = surface.rest_values(mesh);
    let matrix = |rule: TriangleRule| {
        let surface = C1Surface { rule, ..surface.clone() };
        let block = element::c1_prisms(&single, &surface).unwrap();
        let free: Vec<usize> = block.nodes.iter().map(|&n| n as usize).collect();
        dense::stiffness(&[(&block, material)], &rest, &free)
    };
    let exact = matrix(TriangleRule::Collapsed(24)).symmetric_eigen();
    let scale = exact.eigenvalues.amax();
    let kept: Vec<usize> = (0..36).filter(|&i| exact.eigenvalues[i] > 1e-9 * scale).collect();
    assert_eq!(kept.len(), 30);
    let basis =
        nalgebra::DMatrix::from_fn(36, 30, |r, c| exact.eigenvectors[(r, kept[c])] / exact.eigenvalues[kept[c]].sqrt());
    let relative = (basis.transpose() * matrix(surface.rule) * &basis).symmetric_eigenvalues();
    (relative.min(), relative.max())
}

#[test]
fn rules_keep_the_rank_and_nearly_the_eigenvalues_of_the_stiffness() {
    let mesh = curved().mesh();
    let fine = C1Surface::with_rule(&mesh, TriangleRule::Collapsed(24));
    for (rule, low, high) in
        [(RULES[0], 0.55, 1.1), (RULES[1], 0.8, 1.1), (RULES[2], 0.98, 1.01), (RULES[3], 0.95, 1.02)]
    {
        let surface = C1Surface { rule, ..fine.clone() };
        for prism in [1, 8, 13] {
            let (least, most) = relative_spectrum(&mesh, &surface, prism, 0.49);
            println!("{rule:?}: {least:.4} {most:.4}");
            assert!(least > low && most < high, "{rule:?}: {least} {most}");
        }
    }
}

/// The centre of the bottom is pushed up by 1 mm; the other sides are held, the skin is free.
#[test]
fn the_default_rule_changes_displacements_by_less_than_a_thousandth() {
    let slab = curved();
    let mesh = slab.mesh();
    let n = mesh.positions.len();
    let fine = C1Surface::with_rule(&mesh, TriangleRule::Collapsed(12));
    let rest = fine.rest_values(&mesh);
    let tetrahedra = element::tetrahedra(&mesh).unwrap();
    let (fat, skin) = (Material::neo_hookean(0.0118, 0.49), Material::neo_hookean(0.0701, 0.49));
    let free: Vec<usize> = (0..rest.len()).filter(|&i| i >= n || !slab.held_and_skin(i).0).collect();
    let solve = |rule| {
        let surface = C1Surface { rule, ..fine.clone() };
        let prisms = element::c1_prisms(&mesh, &surface).unwrap();
        let mut values = rest.clone();
        for node in [5, 6, 9, 10] {
            values[node].z += 1.0;
        }
        let loads = vec![Vector3::zeros(); rest.len()];
        dense::solve(&[(&tetrahedra, fat), (&prisms, skin)], &mut values, &free, &loads);
        values
    };
    let (exact, found) = (solve(fine.rule), solve(TriangleRule::DEFAULT));
    let skin = (0..n).filter(|&i| slab.held_and_skin(i).1);
    let size = skin.map(|i| (exact[i] - rest[i]).norm()).fold(0.0, f64::max);
    let error = (0..n).map(|i| (exact[i] - found[i]).norm()).fold(0.0, f64::max);
    println!("skin moves {size:.3} mm, the rule's error is {error:.1e} mm");
    assert!(size > 0.5 && error < 1e-3 * size);
}
