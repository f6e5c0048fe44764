//! Rates of convergence: a manufactured solution, and thick shells under internal pressure.

use super::blocks::{Slab, attach};
use crate::fem::material::{Material, Materials, Volumetric};
use crate::fem::{Boundary, Locking, Model, SolveSettings, Solver};
use crate::mesh::{Attachment, MixedMesh, Tissue};
use nalgebra::Matrix3;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};
use std::f64::consts::{FRAC_PI_2, PI};

/// Slope of `ln error` over `ln h` by least squares; `h` halves from one error to the next.
fn rate(errors: &[f64]) -> f64 {
    let n = errors.len() as f64;
    let x: Vec<f64> = (0..errors.len()).map(|i| -(i as f64) * 2f64.ln()).collect();
    let y: Vec<f64> = errors.iter().map(|e| e.ln()).collect();
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let (top, bottom) =
        x.iter().zip(&y).fold((0.0, 0.0), |s, (x, y)| (s.0 + (x - mx) * (y - my), s.1 + (x - mx).powi(2)));
    top / bottom
}

/// Four quadrature points of a tetrahedron, exact for polynomials of degree 2, as weights of its corners.
const QUADRATURE: [[f64; 4]; 4] = {
    const A: f64 = 0.5854101966249685;
    const B: f64 = 0.1381966011250105;
    [[A, B, B, B], [B, A, B, B], [B, B, A, B], [B, B, B, A]]
};

const AMPLITUDE: f64 = 0.08;

fn exact(p: &Vector) -> Vector {
    let (x, y, z) = (p.x, p.y, p.z);
    Vector::new((PI * y).sin() + x * x, (PI * z).sin() - 0.5 * y * y, (PI * x).cos() * z + 0.3 * x * y) * AMPLITUDE
}

fn exact_gradient(p: &Vector) -> Matrix3<f64> {
    let (x, y, z) = (p.x, p.y, p.z);
    let rows = Matrix3::new(
        2.0 * x,
        PI * (PI * y).cos(),
        0.0,
        0.0,
        -y,
        PI * (PI * z).cos(),
        -PI * (PI * x).sin() * z + 0.3 * y,
        0.3 * x,
        (PI * x).cos(),
    );
    rows * AMPLITUDE
}

/// Body force of the exact deformation: minus the divergence of the nominal stress, by central differences with a relative error
/// of about 1e-9.
fn body_force(material: &Material, p: &Vector) -> Vector {
    let h = 1e-4;
    let stress = |p: Vector| material.first_piola(&(Matrix3::identity() + exact_gradient(&p))).unwrap();
    (0..3).fold(Vector::zeros(), |force, axis| {
        let step = Vector::ith(axis, h);
        force - (stress(p + step) - stress(p - step)).column(axis) / (2.0 * h)
    })
}

/// L2 errors of displacement and gradient on a unit cube of `n`³ cells with prescribed displacement on the boundary.
fn manufactured(n: usize, locking: Locking) -> (f64, f64) {
    let mut mesh = Slab { cells: [n; 3], origin: [0.0; 3], size: [1.0; 3], skin: 0.0 }.mesh();
    let on_boundary = |p: &Point| p.iter().any(|c| *c < 1e-9 || *c > 1.0 - 1e-9);
    for (node, p) in mesh.positions.iter().enumerate() {
        if on_boundary(p) {
            mesh.attachment[node] = Attachment::Tied(node as u32);
        }
    }
    let material = Material::neo_hookean(0.02, 0.3);
    let mut loads_n = vec![Vector::zeros(); mesh.positions.len()];
    let corners = |t: &[u32; 4]| t.map(|n| mesh.positions[n as usize].coords);
    let volume = |x: &[Vector; 4]| (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0])) / 6.0;
    let at = |x: &[Vector; 4], w: &[f64; 4]| x.iter().zip(w).map(|(x, w)| x * *w).sum::<Vector>();
    for t in &mesh.tetrahedra {
        let x = corners(t);
        for w in QUADRATURE {
            let force = body_force(&material, &at(&x, &w)) * (0.25 * volume(&x));
            t.iter().zip(w).for_each(|(n, w)| loads_n[*n as usize] += force * w);
        }
    }
    let boundary = Boundary { loads_n, ..Boundary::default() };
    let settings = SolveSettings {
        relative_residual: 1e-8,
        locking,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, vec![], &boundary, settings, &control).unwrap();
    let path = |t: f64| {
        let tied = mesh.positions.iter().enumerate().filter(|(_, p)| on_boundary(p));
        tied.map(|(n, p)| (n as u32, Motion::from(exact(&p.coords) * t))).collect()
    };
    solver.advance(1.0, &path, &control).unwrap();
    let u: Vec<Vector> = solver.positions().iter().zip(&mesh.positions).map(|(x, rest)| x - rest).collect();
    let (mut l2, mut h1) = (0.0, 0.0);
    for t in &mesh.tetrahedra {
        let (x, u) = (corners(t), t.map(|n| u[n as usize]));
        let edges = |v: &[Vector; 4]| Matrix3::from_columns(&[v[1] - v[0], v[2] - v[0], v[3] - v[0]]);
        let gradient = edges(&u) * edges(&x).try_inverse().unwrap();
        for w in QUADRATURE {
            let p = at(&x, &w);
            l2 += 0.25 * volume(&x) * (at(&u, &w) - exact(&p)).norm_squared();
            h1 += 0.25 * volume(&x) * (gradient - exact_gradient(&p)).norm_squared();
        }
    }
    (l2.sqrt(), h1.sqrt())
}

#[test]
fn a_manufactured_solution_converges_with_orders_two_and_one() {
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        let errors = [4, 8, 16].map(|n| manufactured(n, locking));
        // On the coarsest mesh a patch is half as wide as the body.
        let fine = [errors[1], errors[2]];
        let (l2, h1) = (rate(&fine.map(|e| e.0)), rate(&fine.map(|e| e.1)));
        println!("manufactured, {locking:?}: rates {l2:.3} and {h1:.3}, {errors:?}");
        assert!((l2 - 2.0).abs() < 0.1 && (h1 - 1.0).abs() < 0.1, "{locking:?}: {l2} {h1} {errors:?}");
        // On the finest mesh the relative error of the displacement, about 0.08 long, is below a hundredth.
        assert!(errors[2].0 < 8e-4, "{errors:?}");
    }
}

/// An octant of a spherical shell from radius 10 to 20 mm: a triangle of `n`² directions in `n` layers.
fn sphere(n: usize) -> MixedMesh {
    let mut directions = Vec::new();
    let mut number = vec![vec![0; n + 1]; n + 1];
    for i in 0..=n {
        for j in 0..=n - i {
            number[i][j] = directions.len();
            directions.push(Vector::new((n - i - j) as f64, i as f64, j as f64).normalize());
        }
    }
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n - i {
            triangles.push([number[i][j], number[i + 1][j], number[i][j + 1]]);
            if i + j + 1 < n {
                triangles.push([number[i + 1][j], number[i + 1][j + 1], number[i][j + 1]]);
            }
        }
    }
    let m = directions.len();
    let radius = |layer: usize| 10.0 + 10.0 * layer as f64 / n as f64;
    let positions: Vec<Point> =
        (0..=n).flat_map(|k| directions.iter().map(move |d| Point::from(d * radius(k)))).collect();
    let mut tetrahedra = Vec::new();
    for k in 0..n {
        for triangle in &triangles {
            // Split in the order of node numbers, so that neighbours agree.
            let mut t = *triangle;
            t.sort_unstable();
            let [a, b, c] = t.map(|v| (k * m + v) as u32);
            let up = |v: u32| v + m as u32;
            for corners in [[a, b, c, up(c)], [a, b, up(b), up(c)], [a, up(a), up(b), up(c)]] {
                let x = corners.map(|v| positions[v as usize]);
                let inside_out = (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0])) < 0.0;
                let [p, q, r, s] = corners;
                tetrahedra.push(if inside_out { [p, r, q, s] } else { corners });
            }
        }
    }
    MixedMesh {
        attachment: vec![Attachment::Free; positions.len()],
        tetrahedron_tissue: vec![Tissue::Fat; tetrahedra.len()],
        positions,
        tetrahedra,
        prisms: Vec::new(),
        prism_tissue: Vec::new(),
        bone_faces: Vec::new(),
        depth_cut_nodes: Vec::new(),
        facing: Vec::new(),
    }
}

/// A quarter of a cylindrical shell from radius 10 to 20 mm, one cell high.
fn cylinder(n: usize) -> MixedMesh {
    let mut mesh = Slab { cells: [n, n, 1], origin: [0.0; 3], size: [1.0, 1.0, 10.0 / n as f64], skin: 0.0 }.mesh();
    for p in &mut mesh.positions {
        let (angle, radius) = (FRAC_PI_2 * (1.0 - p.x), 10.0 + 10.0 * p.y);
        *p = Point::new(radius * angle.cos(), radius * angle.sin(), p.z);
    }
    mesh
}

/// Mean outward displacement of the nodes at radius 20 and at 15 mm when the inner radius grows from 10 to 12 mm. `axes` is the
/// number of radial axes; the displacement along the others is zero.
fn inflate(mut mesh: MixedMesh, axes: usize) -> [f64; 2] {
    let outward = |p: &Point| Vector::from_fn(|a, _| if a < axes { p[a] } else { 0.0 });
    let radius = |p: &Point| outward(p).norm();
    for (node, p) in mesh.positions.iter().enumerate() {
        if radius(p) < 10.0 + 1e-9 {
            mesh.attachment[node] = Attachment::Tied(node as u32);
        }
    }
    let held = |p: &Point| (0..3).filter(|&a| a >= axes || p[a].abs() < 1e-9).fold(0u8, |bits, a| bits | 1 << a);
    let boundary = Boundary { held_axes: mesh.positions.iter().map(held).collect(), ..Boundary::default() };
    // Fat of the references: a fifth of the modulus from C01, Poisson ratio 0.45.
    let material = Material::mooney_rivlin(4.7105788e-3, 1.1776447e-3, 0.45).with_volumetric(Volumetric::Quadratic);
    let settings = SolveSettings {
        relative_residual: 1e-8,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, vec![], &boundary, settings, &control).unwrap();
    let path = |t: f64| {
        let inner = mesh.positions.iter().enumerate().filter(|(_, p)| radius(p) < 10.0 + 1e-9);
        inner.map(|(n, p)| (n as u32, Motion::from(outward(p) * (0.2 * t)))).collect()
    };
    for step in 1..=2 {
        solver.advance(0.5 * f64::from(step), &path, &control).unwrap();
    }
    let now = solver.positions();
    [20.0, 15.0].map(|at| {
        let there = mesh.positions.iter().zip(&now).filter(|(rest, _)| (radius(rest) - at).abs() < 1e-6);
        let moved: Vec<f64> = there.map(|(rest, x)| (x - rest).dot(&outward(rest)) / radius(rest)).collect();
        moved.iter().sum::<f64>() / moved.len() as f64
    })
}

/// Against the radial equation solved with 30 digits (`c_inflation.csv` of the project's references).
#[test]
fn thick_shells_converge_with_order_two() {
    let sphere_exact = [0.6565657767612727, 1.050770359324538];
    let cylinder_exact = [1.1450620821842001, 1.4422576834182017];
    let spheres = [4, 8, 16].map(|n| inflate(sphere(n), 3));
    let cylinders = [4, 8, 16].map(|n| inflate(cylinder(n), 2));
    for (name, found, exact) in [("sphere", spheres, sphere_exact), ("cylinder", cylinders, cylinder_exact)] {
        for at in 0..2 {
            let errors = found.map(|u| (u[at] / exact[at] - 1.0).abs());
            println!("{name}: rate {:.3}, {errors:?}", rate(&errors));
            assert!(rate(&errors) > 1.8, "{name}: {errors:?}");
            assert!(errors[2] < 5e-3, "{name}: {errors:?}");
        }
    }
}

/// Any other order of the nodes gives the same result up to rounding.
#[test]
fn renumbered_nodes_give_the_same_answer() {
    let mut mesh = Slab { cells: [6, 6, 2], origin: [0.0; 3], size: [24.0, 24.0, 8.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(if p.x > 12.0 { Attachment::Tied(1) } else { Attachment::Tied(0) }));
    let n = mesh.positions.len();
    // A prime that does not divide the number of nodes: its multiples reach all nodes.
    let step = 61;
    assert_ne!(n % step, 0);
    let place = |node: usize| (node * step + 5) % n;
    let mut other = mesh.clone();
    for node in 0..n {
        other.positions[place(node)] = mesh.positions[node];
        other.attachment[place(node)] = mesh.attachment[node];
    }
    let renumber = |node: &mut u32| *node = place(*node as usize) as u32;
    other.tetrahedra.iter_mut().flatten().for_each(renumber);
    other.prisms.iter_mut().flatten().for_each(renumber);
    other.bone_faces.iter_mut().flatten().for_each(renumber);
    other.tetrahedra.reverse();
    let material = |shear: f64| Material::neo_hookean(shear, 0.45);
    let (skin, fat) = (material(0.07), material(0.012));
    let materials = Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat };
    let control = Control::new();
    for (model, locking) in
        [(Model::Nonlinear, Locking::None), (Model::Nonlinear, Locking::Smoothed), (Model::Mixed, Locking::Smoothed)]
    {
        let solve = |mesh: &MixedMesh| {
            let settings = SolveSettings { relative_residual: 1e-11, locking, ..SolveSettings::new(model, materials) };
            let mut solver = Solver::new(mesh, vec![], settings, &control).unwrap();
            solver.advance(1.0, &|t| vec![(1, Motion::translation(0.0, t, 3.0 * t))], &control).unwrap();
            solver.positions()
        };
        let (here, there) = (solve(&mesh), solve(&other));
        let worst = (0..n).map(|node| (here[node] - there[place(node)]).norm()).fold(0.0, f64::max);
        assert!(worst < 1e-9 * 3.2, "{model:?} {locking:?}: {worst:.1e} mm");
    }
}
