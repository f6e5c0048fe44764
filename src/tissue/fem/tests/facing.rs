//! Tissue on tissue: derivatives, patch test, balance of forces, overlap, opening, closing and sliding.

use super::blocks::Slab;
use super::two_blocks::{Pair, overlap_mm};
use crate::fem::dot::dot;
use crate::fem::equations::Equations;
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, Model, PhaseTimes, Preset, SkinElement, SolveSettings, Solver, StepReport};
use crate::mesh::{Attachment, Facing, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};

const LOWER: Slab = Slab { cells: [4, 4, 2], origin: [0.0; 3], size: [12.0, 12.0, 6.0], skin: 0.0 };
const UPPER: Slab = Slab { cells: [5, 3, 2], origin: [0.0, 0.0, 6.0], size: [12.0, 12.0, 6.0], skin: 0.0 };

fn still(_: f64) -> Vec<(u32, Motion)> {
    Vec::new()
}

fn noise(n: usize, seed: f64) -> Vec<f64> {
    (0..n).map(|i| (seed * (i as f64 + 1.0)).sin()).collect()
}

/// Bottom fixed, top tied to segment 1.
fn held(pair: &Pair) -> MixedMesh {
    let mut mesh = pair.mesh.clone();
    let top = mesh.positions.iter().map(|p| p.z).fold(0.0, f64::max);
    for (p, a) in mesh.positions.iter().zip(&mut mesh.attachment) {
        if p.z < 1e-9 {
            *a = Attachment::Fixed;
        } else if p.z > top - 1e-9 {
            *a = Attachment::Tied(1);
        }
    }
    mesh
}

#[test]
fn forces_and_stiffness_of_tissue_on_tissue_are_derivatives_of_the_energy() {
    let mut pair = Pair::new(LOWER, UPPER);
    // Both surfaces are curved, so points touch faces, edges and corners.
    for p in &mut pair.mesh.positions {
        p.z += 0.2 * (0.9 * p.x).sin() * (0.7 * p.y).cos() * (p.z / 6.0).min(2.0 - p.z / 6.0);
    }
    let mesh = held(&pair);
    let control = Control::new();
    for skin_element in [SkinElement::Wedge, SkinElement::C1Prism] {
        let settings = SolveSettings { skin_element, ..SolveSettings::new(Model::Mixed, Preset::Wang2009.materials()) };
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let equations = &mut solver.equations;
        let n = 3 * equations.problem.dofs().n_unknown();
        let mut x = equations.problem.dofs().rest().to_vec();
        // The upper block is pressed into the lower one and aside.
        for (node, x) in x.iter_mut().enumerate().skip(pair.n_lower) {
            *x += Vector::new(0.31, -0.17, -0.25) + Vector::new(0.1, 0.0, 0.05) * (node as f64).sin();
        }
        equations.problem.dofs().add(0.05, &noise(n, 1.3), &mut x);
        let balance = equations.balance(&x, &[]).unwrap();
        assert!(balance.contacts.len() > 100, "{}", balance.contacts.len());
        equations.state.contact.augment(&balance.contacts);
        let d = noise(n, 2.1);
        let along = |equations: &mut Equations<'_>, h: f64| {
            let mut y = x.clone();
            equations.problem.dofs().add(h, &d, &mut y);
            let energy = equations.balance(&y, &[]).unwrap().energy;
            (energy, equations.work.residual().to_vec())
        };
        let h = 1e-7;
        let ((before, r0), (after, r1)) = (along(equations, -h), along(equations, h));
        let contacts = equations.balance(&x, &[]).unwrap().contacts;
        let slope = dot(equations.work.residual(), &d);
        // Central differences have errors of order h² and 1e-16/h.
        assert!(((after - before) / (2.0 * h) - slope).abs() < 1e-6 * slope.abs(), "{slope}");
        equations.stiffness(&x, &contacts, &[]).unwrap();
        let mut kd = vec![0.0; n];
        equations.work.multiply(&equations.problem, &d, &mut kd);
        let scale = dot(&kd, &kd).sqrt();
        let error: f64 = (0..n).map(|i| ((r1[i] - r0[i]) / (2.0 * h) - kd[i]).powi(2)).sum::<f64>().sqrt() / scale;
        assert!(error < 1e-6, "{error:.2e}");
    }
}

/// Uniaxial compression of two blocks of the same material with unlike meshes: the stress is that of one block everywhere.
#[test]
fn a_uniform_pressure_passes_through_unlike_meshes() {
    let cases: [([usize; 3], [usize; 3]); 3] = [([4, 4, 2], [5, 3, 2]), ([3, 3, 2], [4, 4, 2]), ([3, 3, 2], [8, 7, 3])];
    for (lower, upper) in cases {
        let mut pair = Pair::new(Slab { cells: lower, ..LOWER }, Slab { cells: upper, ..UPPER });
        pair.crook(0.15);
        let boundary = pair.compressed(1.2);
        let materials = Materials::homogeneous(Material::neo_hookean(0.01, 0.3));
        let settings = SolveSettings { relative_residual: 1e-9, ..SolveSettings::new(Model::Nonlinear, materials) };
        let control = Control::new();
        let mut solver = Solver::with_boundary(&pair.mesh, vec![], &boundary, settings, &control).unwrap();
        let report = solver.advance(1.0, &still, &control).unwrap();
        let stress: Vec<f64> = solver.cell_states().0.iter().map(|c| c.stress_mpa[2]).collect();
        let mean = stress.iter().sum::<f64>() / stress.len() as f64;
        let worst = stress.iter().map(|s| (s / mean - 1.0).abs()).fold(0.0, f64::max);
        println!("patch {lower:?} {upper:?}: mean {mean:.5} MPa, jump {worst:.2e}, {report:?}");
        assert!(mean < -0.002 && worst < 0.01, "{lower:?} {upper:?} {mean} {worst:.2e}");
    }
}

/// Total force and moment of contact on each block.
fn balance_of(solver: &mut Solver<'_>, n_lower: usize) -> [[Vector; 2]; 2] {
    let x = solver.reached.x.clone();
    let contacts = solver.equations.state.contact.active_contacts(&x, &[]);
    let mut forces = vec![Vector::zeros(); x.len()];
    solver.equations.state.contact.add_forces(&contacts, &mut forces);
    let sum = |range: std::ops::Range<usize>| {
        range.fold([Vector::zeros(); 2], |[f, m], i| [f + forces[i], m + x[i].cross(&forces[i])])
    };
    [sum(0..n_lower), sum(n_lower..x.len())]
}

/// Lips pressed together by 30 %, opened by 10 mm, and sheared by 10 mm while pressed.
#[test]
fn lips_close_open_and_slide_without_overlap_and_in_balance() {
    for (name, skin) in [("tetrahedra", 0.0), ("with prisms", 1.5)] {
        let mut pair = Pair::new(
            Slab { cells: [10, 4, 3], origin: [0.0; 3], size: [30.0, 10.0, 8.0], skin },
            Slab { cells: [5, 3, 3], origin: [1.0, 0.3, 8.0 + skin], size: [14.0, 9.0, 8.0], skin: 0.0 },
        );
        pair.round(2.5);
        let mesh = held(&pair);
        let control = Control::new();
        let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
        // Down by 30 % of both, along, back, and apart.
        let path = |t: f64| {
            let mix = |from: [f64; 3], to: [f64; 3], s: f64| (0..3).map(|i| from[i] + s * (to[i] - from[i])).collect();
            let down = -0.3 * (16.0 + skin);
            let stops = [[0.0; 3], [0.0, 0.0, down], [10.0, 0.0, down], [14.0, 0.0, 0.5 * down], [14.0, 0.0, 10.0]];
            let leg = (t.floor() as usize).min(3);
            let at: Vec<f64> = mix(stops[leg], stops[leg + 1], t - leg as f64);
            vec![(1, Motion::translation(at[0], at[1], at[2]))]
        };
        let mut solver = Solver::new(&mesh, vec![], settings.clone(), &control).unwrap();
        for step in 1..=4 {
            let report = solver.advance(f64::from(step), &path, &control).unwrap();
            let overlap = overlap_mm(&mesh, &solver.positions(), 12);
            let [[f, m], [g, l]] = balance_of(&mut solver, pair.n_lower);
            println!("lips {name}, leg {step}: overlap {overlap:.4} mm, force {:.4} N, {report:?}", f.norm());
            assert!(report.outcome.converged());
            assert!(overlap <= 0.05, "{overlap}");
            assert!((f + g).norm() <= 1e-6 * f.norm() && (m + l).norm() <= 1e-6 * m.norm());
            if step < 4 {
                assert!(report.active_contacts > 10 && f.norm() > 1e-3, "{report:?}");
            } else {
                // Apart, both are as at rest.
                assert_eq!(report.active_contacts, 0);
                let top = path(4.0)[0].1;
                for (i, (now, rest)) in solver.positions().iter().zip(&mesh.positions).enumerate() {
                    let rigid = if i < pair.n_lower { *rest } else { top * rest };
                    assert!((now - rigid).norm() < 2e-3, "{now} {rest}");
                }
            }
        }
    }
}

/// Conforming blocks that share no node, in compression, against the same mesh with merged nodes: the slit is closed everywhere.
#[test]
fn a_closed_slit_gives_the_glued_answer() {
    let slab = Slab { cells: [6, 6, 2], origin: [0.0; 3], size: [18.0, 18.0, 6.0], skin: 0.0 };
    // The upper block mirrors the lower one, and so do the displacements: there is no shear between them that would make
    // frictionless tissue slide.
    let pair = Pair::mirrored(slab);
    let glued = pair.glued();
    let hold = |mesh: &MixedMesh| {
        let mut boundary = Boundary {
            held_axes: vec![0; mesh.positions.len()],
            prescribed_mm: vec![Vector::zeros(); mesh.positions.len()],
            ..Boundary::default()
        };
        for (i, p) in mesh.positions.iter().enumerate() {
            if p.z < 1e-9 || p.z > 12.0 - 1e-9 {
                boundary.held_axes[i] = 7;
                boundary.prescribed_mm[i].z = (1.0 + 0.025 * p.x) * if p.z < 1e-9 { 1.0 } else { -1.0 };
            }
        }
        boundary
    };
    let control = Control::new();
    let materials = Materials::homogeneous(Material::neo_hookean(0.01, 0.45));
    let solve = |mesh: &MixedMesh| {
        let settings = SolveSettings::new(Model::Nonlinear, materials);
        let mut solver = Solver::with_boundary(mesh, vec![], &hold(mesh), settings, &control).unwrap();
        let report = solver.advance(1.0, &still, &control).unwrap();
        (solver.positions(), report)
    };
    let ((slit, report), (whole, _)) = (solve(&pair.mesh), solve(&glued));
    let at = |p: &Point| glued.positions.iter().position(|q| (q - p).norm() < 1e-9).unwrap();
    let off = |(now, rest): (&Point, &Point)| (now - whole[at(rest)]).norm();
    let worst = slit.iter().zip(&pair.mesh.positions).map(off).fold(0.0, f64::max);
    println!("glued: {worst:.5} mm, {report:?}");
    assert!(worst < 0.01, "{worst}");
}

/// A block at rest on another, with slight overlap: nothing moves.
#[test]
fn tissue_that_touches_or_overlaps_at_rest_is_not_pressed_apart() {
    for overlap in [0.0, 0.07, 0.2] {
        let mut pair = Pair::new(LOWER, Slab { origin: [0.4, -0.3, 6.0 - overlap], ..UPPER });
        pair.crook(0.1);
        let mesh = held(&pair);
        let control = Control::new();
        let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let report = solver.advance(0.0, &still, &control).unwrap();
        let is_reported = report.warnings.iter().any(|w| w.code == "facing-overlap-at-rest");
        assert_eq!(is_reported, overlap > 0.1, "{:?}", report.warnings);
        for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
            assert!((now - rest).norm() < 1e-9);
        }
        // Pressed farther, it pushes.
        let down = |t: f64| vec![(1, Motion::translation(0.0, 0.0, -t))];
        let report = solver.advance(1.0, &down, &control).unwrap();
        assert!(report.active_contacts > 50 && report.reactions_n[0].1[2] < -1e-3, "{report:?}");
    }
}

/// A block of 24 x 3 x 9 mm whose top lies `depth(|x|)` mm lower; the whole top may touch itself.
fn creased(cells: [usize; 3], depth: impl Fn(f64) -> f64) -> MixedMesh {
    let mut mesh = Slab { cells, origin: [-12.0, 0.0, 0.0], size: [24.0, 3.0, 9.0], skin: 0.0 }.mesh();
    for p in &mut mesh.positions {
        p.z *= (9.0 - depth(p.x.abs())) / 9.0;
    }
    let layers = cells[2] + 1;
    let is_top = |t: &[u32; 3]| t.iter().all(|n| *n as usize % layers == layers - 1);
    let top: Vec<[u32; 3]> = crate::mesh::boundary_triangles(&mesh).into_iter().filter(is_top).collect();
    assert_eq!(top.len(), 2 * cells[0] * cells[1]);
    mesh.facing = vec![Facing { sides: [top.clone(), top] }];
    for (p, a) in mesh.positions.iter().zip(&mut mesh.attachment) {
        if p.x.abs() > 12.0 - 1e-9 {
            *a = Attachment::Tied(if p.x > 0.0 { 1 } else { 2 });
        }
    }
    mesh
}

/// Overlap, mm, with contact and without it, and the number of active points, when the ends have come nearer by `by` mm each.
fn closed(mesh: &MixedMesh, by: f64) -> (f64, f64, usize) {
    let control = Control::new();
    let close = |t: f64| [(1, -1.0), (2, 1.0)].map(|(s, to)| (s, Motion::translation(to * by * t, 0.0, 0.0))).to_vec();
    let solve = |mesh: &MixedMesh| {
        let settings = SolveSettings::new(Model::Mixed, Materials::homogeneous(Material::neo_hookean(0.01, 0.3)));
        let mut solver = Solver::new(mesh, vec![], settings, &control).unwrap();
        for t in [0.5, 0.7, 0.85] {
            solver.advance(t, &close, &control).unwrap();
        }
        let report = solver.advance(1.0, &close, &control).unwrap();
        (solver.positions(), report.active_contacts)
    };
    let free = MixedMesh { facing: Vec::new(), ..mesh.clone() };
    let ((touching, active), (passed, _)) = (solve(mesh), solve(&free));
    let found = (overlap_mm(mesh, &touching, 12), overlap_mm(mesh, &passed, 12), active);
    println!("crease: overlap with contact, without it, points: {found:.4?}");
    found
}

/// The sharp shoulders of a groove, ridges of single cells, touch between the points of their triangles: contact acts, but they
/// overlap by more than smooth sides do.
#[test]
fn a_groove_closes_on_its_shoulders() {
    let groove = creased([32, 2, 6], |x| 2.0 * (1.0 + ((1.6 - x) * 1.5).tanh()));
    let (overlap, without, active) = closed(&groove, 3.4);
    assert!(active >= 4 && without > 0.7 && overlap < 0.15, "{overlap} {without} {active}");
}

/// Two round bulges meet in a crease. Few, strongly turned triangles touch, so between their points they overlap by more than flat
/// sides do; less on finer cells.
#[test]
fn a_crease_closes_on_itself() {
    for (cells, by, allowed) in [([32, 2, 6], 3.0, 0.1), ([48, 3, 6], 2.5, 0.07)] {
        let crease = creased(cells, |x| 4.0 * (1.0 - x / 4.0).max(0.0).powi(2));
        let (overlap, without, active) = closed(&crease, by);
        assert!(active >= 4 && without > 0.4 && overlap < allowed, "{overlap} {without} {active}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits_with_facing_tissue() {
    let mut pair = Pair::new(LOWER, UPPER);
    pair.round(0.5);
    let mesh = held(&pair);
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let control = Control::new();
            let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
            let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
            let down = |t: f64| vec![(1, Motion::translation(t, 0.0, -2.5 * t))];
            let report = solver.advance(1.0, &down, &control).unwrap();
            (solver.positions(), report.newton_iterations, report.active_contacts)
        })
    };
    let one = solve(1);
    assert!(one.2 > 50);
    assert_eq!(one, solve(3));
}

/// Force, mN, of two equal caps of radius 20 mm on blocks of 40 mm that approach each other by 0.5 mm, and the mean square of the
/// relative cell sizes. The blocks have unlike meshes, fine near the contact, with `n` and `n + 1` cells along each edge.
fn force_of_two_caps(n: usize) -> (f64, f64) {
    let unit = |n: usize, z: f64| Slab { cells: [n; 3], origin: [0.0, 0.0, z], size: [1.0; 3], skin: 0.0 };
    let mut pair = Pair::new(unit(n, 0.0), unit(n + 1, 1.0));
    let grade = |s: f64| 4.0 * s + 36.0 * s.powi(4);
    for (i, p) in pair.mesh.positions.iter_mut().enumerate() {
        let is_upper = i >= pair.n_lower;
        let (x, y, depth) = (grade(p.x), grade(p.y), grade(if is_upper { p.z - 1.0 } else { 1.0 - p.z }));
        // Far from the contact the surface is flat.
        let away = (x * x + y * y).min(100.0) / 40.0 * (1.0 - depth / 40.0);
        *p = Point::new(x, y, if is_upper { depth + away } else { -depth - away });
    }
    for (p, a) in pair.mesh.positions.iter().zip(&mut pair.mesh.attachment) {
        if p.z.abs() > 39.9 {
            *a = if p.z > 0.0 { Attachment::Tied(1) } else { Attachment::Fixed };
        }
    }
    let held = |p: &Point| u8::from(p.x == 0.0) + 2 * u8::from(p.y == 0.0);
    let boundary = Boundary { held_axes: pair.mesh.positions.iter().map(held).collect(), ..Boundary::default() };
    let materials = Materials::homogeneous(Material::neo_hookean(0.011776447, 0.3));
    let settings = SolveSettings { penetration_tolerance_mm: 0.002, ..SolveSettings::new(Model::Mixed, materials) };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&pair.mesh, vec![], &boundary, settings, &control).unwrap();
    let down = |t: f64| vec![(1, Motion::translation(0.0, 0.0, -0.5 * t))];
    let report = solver.advance(1.0, &down, &control).unwrap();
    println!(
        "caps {n}: {:?}, {} contacts, {} iterations",
        report.reactions_n, report.active_contacts, report.newton_iterations
    );
    let size_sq = |n: usize| 0.5 / (n * n) as f64;
    // A quarter is modelled.
    (-4e3 * report.reactions_n[0].1[2], size_sq(n) + size_sq(n + 1))
}

/// Hertz: `F = 4/3 E* sqrt(R) d^1.5` with `1/R = 2/20 mm`, `E* = E/(1 - nu²)/2` and d = 0.5 mm is 25.08 mN on half-spaces. A ball
/// of 10 mm on a block of the same size and half the compliance has the same contact radius, so the same share of its approach
/// lies outside the contact: its independent reference `d_hertz.csv`, 53.22 mN against 50.16 on a half-space, gives 26.61 mN.
#[test]
fn two_elastic_caps_press_on_each_other_as_hertz_says() {
    let ((coarse, a), (fine, b)) = (force_of_two_caps(12), force_of_two_caps(16));
    let limit = (fine * a - coarse * b) / (a - b);
    println!("caps: {coarse:.3} {fine:.3} limit {limit:.3} mN");
    assert!((limit / 26.61 - 1.0).abs() < 0.02 && fine < coarse, "{coarse} {fine} {limit}");
}

#[test]
fn a_checkpoint_of_pressed_lips_continues_with_the_same_bits() {
    let mut pair = Pair::new(LOWER, UPPER);
    pair.round(0.5);
    let mesh = held(&pair);
    let control = Control::new();
    let down = |t: f64| vec![(1, Motion::translation(t, 0.0, -3.0 * t))];
    // Soft enough that the multipliers act.
    let settings = SolveSettings {
        contact_stiffness_factor: 0.01,
        ..SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials())
    };
    let new = || Solver::new(&mesh, vec![], settings.clone(), &control).unwrap();
    let step = |solver: &mut Solver<'_>, t: f64| {
        let report = solver.advance(t, &down, &control).unwrap();
        (StepReport { phases: PhaseTimes::default(), ..report }, solver.positions())
    };
    let mut whole = new();
    step(&mut whole, 0.7);
    let kept = whole.checkpoint().unwrap();
    assert!(!kept.multipliers.is_empty() && !kept.active.is_empty());
    let mut after = new();
    after.restore(&kept).unwrap();
    assert_eq!(after.checkpoint().as_ref(), Some(&kept));
    assert_eq!(step(&mut after, 1.0), step(&mut whole, 1.0));
}
