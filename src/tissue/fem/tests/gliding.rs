//! Tissue that glides on bone, holds, and foundations.

use super::blocks::{Slab, attach};
use super::bodies::{Ball, Floor};
use crate::fem::dot::dot;
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, ContactBody, Model, Preset, SolveError, SolveSettings, Solver};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, Vector};

fn path(end: Vector) -> impl Fn(f64) -> Vec<(u32, Motion)> {
    move |t| vec![(1, Motion::new(end * t, Vector::zeros()))]
}

/// A slab whose bottom glides on segment 1, with the rim fixed.
fn gliding_slab(cells: usize) -> MixedMesh {
    let mut mesh =
        Slab { cells: [cells, cells, 2], origin: [-15.0, -15.0, 0.0], size: [30.0, 30.0, 8.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let rim = p.x.abs() > 14.9 || p.y.abs() > 14.9;
        if rim { Some(Attachment::Fixed) } else { (p.z == 0.0).then_some(Attachment::Gliding(1)) }
    });
    mesh
}

fn body(solid: &dyn Implicit) -> Vec<ContactBody<'_>> {
    vec![ContactBody { segment: 1, solid }]
}

fn neo_hookean() -> Materials {
    Materials::homogeneous(Material::neo_hookean(0.02, 0.4))
}

fn largest(a: &[Point], b: &[Point]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn forces_and_stiffness_of_springs_are_derivatives_of_their_energy() {
    let mesh = gliding_slab(4);
    let control = Control::new();
    let ball = Ball { centre: Point::new(2.0, -1.0, -30.0), radius: 30.0 };
    let tied_share = (0..mesh.positions.len()).map(|i| 0.8 * (i as f64).sin().abs()).collect();
    let foundation_n_mm = mesh.positions.iter().map(|p| if p.z > 7.0 { 0.02 } else { 0.0 }).collect();
    let boundary = Boundary { tied_share, foundation_n_mm, ..Boundary::default() };
    let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
    let mut solver = Solver::with_boundary(&mesh, body(&ball), &boundary, settings, &control).unwrap();
    let equations = &mut solver.equations;
    let motions = [Motion::new(Vector::new(0.2, 0.1, 0.3), Vector::new(0.05, -0.02, 0.0))];
    let n = 3 * equations.problem.dofs().n_unknown();
    let noise = |seed: f64| -> Vec<f64> { (0..n).map(|i| (seed * (i as f64 + 1.0)).sin()).collect() };
    let mut x = equations.problem.dofs().rest().to_vec();
    equations.problem.dofs().add(0.05, &noise(1.3), &mut x);
    equations.state.springs.augment(&x, &motions);
    let d = noise(2.1);
    let along = |equations: &mut crate::fem::equations::Equations<'_>, h: f64| {
        let mut y = x.clone();
        equations.problem.dofs().add(h, &d, &mut y);
        let energy = equations.balance(&y, &motions).unwrap().energy;
        (energy, equations.work.residual().to_vec())
    };
    let h = 1e-6;
    let ((before, r0), (after, r1)) = (along(equations, -h), along(equations, h));
    let contacts = equations.balance(&x, &motions).unwrap().contacts;
    assert!(contacts.is_empty(), "gliding nodes are no contact points");
    let slope = dot(equations.work.residual(), &d);
    // Central differences have errors of order h² and 1e-16/h; the ball's second derivatives come from differences too.
    assert!(((after - before) / (2.0 * h) - slope).abs() < 1e-6 * slope.abs(), "{slope}");
    equations.stiffness(&x, &contacts, &motions).unwrap();
    let mut kd = vec![0.0; n];
    equations.work.multiply(&equations.problem, &d, &mut kd);
    let scale = dot(&kd, &kd).sqrt();
    let error: f64 = (0..n).map(|i| ((r1[i] - r0[i]) / (2.0 * h) - kd[i]).powi(2)).sum::<f64>().sqrt() / scale;
    assert!(error < 1e-6, "{error:.2e}");
}

/// On a flat body gliding is the same as nodes that are held along the normal and free along the surface, whether the body
/// pushes or pulls and wherever it moves sideways.
#[test]
fn gliding_on_a_plane_is_held_along_the_normal_and_free_along_it() {
    let control = Control::new();
    let glides = gliding_slab(6);
    let mut held = glides.clone();
    attach(&mut held, |p| (p.z == 0.0 && p.x.abs() < 14.9 && p.y.abs() < 14.9).then_some(Attachment::Free));
    let moving: Vec<bool> = glides.attachment.iter().map(|a| *a == Attachment::Gliding(1)).collect();
    for (model, up, sideways) in [(Model::Mixed, 2.0, 4.0), (Model::Mixed, -2.0, 0.0), (Model::Linear, -1.0, 3.0)] {
        let settings = SolveSettings { relative_residual: 1e-8, ..SolveSettings::new(model, neo_hookean()) };
        let boundary = Boundary {
            held_axes: moving.iter().map(|m| if *m { 4 } else { 0 }).collect(),
            prescribed_mm: moving.iter().map(|m| Vector::z() * if *m { up } else { 0.0 }).collect(),
            ..Boundary::default()
        };
        let mut reference = Solver::with_boundary(&held, vec![], &boundary, settings.clone(), &control).unwrap();
        reference.advance(1.0, &|_| Vec::new(), &control).unwrap();
        let mut solver = Solver::new(&glides, body(&Floor), settings, &control).unwrap();
        let report = solver.advance(1.0, &path(Vector::new(sideways, 0.0, up)), &control).unwrap();
        let off = largest(&solver.positions(), &reference.positions());
        // The distance is kept to the tolerance of penetration, 0.05 mm; the springs are stiff enough for a fifth of it.
        assert!(report.gliding_gap_mm < 0.01, "{model:?}: {}", report.gliding_gap_mm);
        assert!(off < 0.01, "{model:?} {up}: {off}");
        // Nothing pulls along the surface.
        let (_, force) = report.reactions_n.iter().find(|(s, _)| *s == 1).unwrap();
        assert!(force[2] * up > 0.0 && force[0].abs() < 1e-6 * force[2].abs(), "{force:?}");
    }
}

/// Displacement around a rigid ball of radius `a` that moves by `d` in an infinite elastic body and slides on it: Kelvin's
/// solution and a dipole without shear stress on the ball.
fn around_a_sliding_ball(p: &Point, a: f64, d: &Vector, poisson: f64) -> Vector {
    let (r, n) = (p.coords.norm(), p.coords.normalize());
    let kelvin = 3.0 * a / (14.0 - 16.0 * poisson);
    let dipole = -kelvin * a * a * (1.0 - 2.0 * poisson) / 3.0;
    (d * (3.0 - 4.0 * poisson) + n * d.dot(&n)) * (kelvin / r) + (d - n * (3.0 * d.dot(&n))) * (dipole / r.powi(3))
}

/// Largest error on the ball, relative to its movement, with `n` cells along each side.
fn error_around_a_ball(n: usize, bulge: f64) -> f64 {
    const A: f64 = 10.0;
    let mut mesh = Slab { cells: [n, n, n], origin: [-0.6, -0.6, 0.0], size: [1.2, 1.2, 1.0], skin: 0.0 }.mesh();
    let on_side = |p: &Point| p.x.abs() > 0.599 || p.y.abs() > 0.599 || p.z > 0.999;
    let sides: Vec<bool> = mesh.positions.iter().map(on_side).collect();
    for (p, attachment) in mesh.positions.iter_mut().zip(&mut mesh.attachment) {
        if p.z == 0.0 && !on_side(p) {
            *attachment = Attachment::Gliding(1);
        }
        // Graded towards the ball.
        *p = Point::from(Vector::new(p.x, p.y, 1.0).normalize() * (A * 2.0f64.powf(p.z)));
    }
    let (poisson, d) = (0.3, Vector::new(0.03, -0.02, 0.04));
    let exact = |p: &Point| around_a_sliding_ball(p, A, &d, poisson);
    let boundary = Boundary {
        held_axes: sides.iter().map(|side| if *side { 7 } else { 0 }).collect(),
        prescribed_mm: mesh
            .positions
            .iter()
            .zip(&sides)
            .map(|(p, s)| if *s { exact(p) } else { Vector::zeros() })
            .collect(),
        ..Boundary::default()
    };
    // Curvature as small strain sees it: the ball glides in the tangent plane where its radius is large against its way.
    let ball = Ball { centre: Point::origin(), radius: A + bulge };
    let settings = SolveSettings {
        relative_residual: 1e-8,
        penetration_tolerance_mm: 1e-4,
        ..SolveSettings::new(Model::Linear, Materials::homogeneous(Material::neo_hookean(0.02, poisson)))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, body(&ball), &boundary, settings, &control).unwrap();
    solver.advance(1.0, &path(d), &control).unwrap();
    let at_ball = mesh.positions.iter().zip(solver.positions()).zip(&mesh.attachment);
    let gliding = at_ball.filter(|(_, a)| **a == Attachment::Gliding(1));
    gliding.map(|((rest, now), _)| (now - rest - exact(rest)).norm()).fold(0.0, f64::max) / d.norm()
}

#[test]
fn tissue_glides_round_a_ball_as_in_closed_form() {
    let [coarse, fine] = [4, 8].map(|n| error_around_a_ball(n, 0.0));
    // Linear elements: the error falls with the square of the edge. The way of 0.05 mm on a radius of 10 mm bends the path by
    // 2e-4 of it.
    assert!(fine < 0.02, "{coarse} {fine}");
    assert!(fine < 0.4 * coarse, "{coarse} {fine}");
    // A node that overlaps the ball at rest, or stands off it, keeps its distance.
    for bulge in [-0.3, 0.3] {
        let off = error_around_a_ball(4, bulge);
        assert!((off - coarse).abs() < 0.02, "{bulge}: {off} {coarse}");
    }
}

/// A column between two parallel inclined planes, drawn out by pulling one of them along its normal while it also slides: the
/// column is stretched along the normal, uniformly and with stress-free sides.
#[test]
fn a_column_between_inclined_planes_is_stretched_uniformly() {
    struct Plane(Vector, f64);
    impl Implicit for Plane {
        fn value(&self, p: &Point) -> f64 {
            self.0.dot(&p.coords) - self.1
        }
        fn value_gradient(&self, p: &Point) -> (f64, Vector) {
            (self.value(p), self.0)
        }
    }
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector::x_axis(), 0.5)
        * nalgebra::Rotation3::from_axis_angle(&Vector::z_axis(), 0.3);
    let mut mesh = Slab { cells: [3, 3, 4], origin: [0.0; 3], size: [6.0, 6.0, 8.0], skin: 0.0 }.mesh();
    // Faces of the top as well; bone faces are counter-clockwise seen from bone.
    let (top, bottom) = (|p: &Point| p.z == 8.0, |p: &Point| p.z == 0.0);
    let upper: Vec<[u32; 3]> = crate::mesh::boundary_triangles(&mesh)
        .into_iter()
        .filter(|t| t.iter().all(|n| top(&mesh.positions[*n as usize])))
        .collect();
    mesh.bone_faces.extend(upper);
    attach(
        &mut mesh,
        |p| {
            if top(p) { Some(Attachment::Gliding(2)) } else { bottom(p).then_some(Attachment::Gliding(1)) }
        },
    );
    // Weak springs at one edge hold it against turning and sliding, which cost no energy.
    let foundation_n_mm = mesh.positions.iter().map(|p| if p.z == 4.0 { 1e-5 } else { 0.0 }).collect();
    let at_rest = mesh.positions.clone();
    mesh.positions.iter_mut().for_each(|p| *p = turn * *p);
    let normal = turn * Vector::z();
    let (lower, upper) = (Plane(normal, 0.0), Plane(-normal, -8.0));
    let bodies =
        vec![ContactBody { segment: 1, solid: &lower as &dyn Implicit }, ContactBody { segment: 2, solid: &upper }];
    let material = Material::neo_hookean(0.02, 0.4);
    let boundary = Boundary { foundation_n_mm, ..Boundary::default() };
    let settings = SolveSettings {
        relative_residual: 1e-8,
        penetration_tolerance_mm: 1e-4,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(material))
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, bodies, &boundary, settings, &control).unwrap();
    let slide = turn * Vector::new(3.0, -2.0, 0.0);
    let motions = |t: f64| vec![(2, Motion::new((normal * 1.6 + slide) * t, Vector::zeros()))];
    let report = solver.advance(1.0, &motions, &control).unwrap();
    // The transverse stretch at which the sides are free of stress, by bisection.
    let stress = |across: f64| {
        let f = nalgebra::Matrix3::from_diagonal(&Vector::new(across, across, 1.2));
        material.first_piola(&f).unwrap()
    };
    let (mut low, mut high) = (0.5, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if stress(middle)[(0, 0)] > 0.0 { high = middle } else { low = middle }
    }
    let centre = |points: &[Point]| points.iter().map(|p| p.coords).sum::<Vector>() / points.len() as f64;
    let now: Vec<Point> = solver.positions().iter().map(|p| turn.inverse() * p).collect();
    let (c0, c1) = (centre(&at_rest), centre(&now));
    for (rest, now) in at_rest.iter().zip(&now) {
        let from = rest.coords - c0;
        let exact = c1 + Vector::new(low * from.x, low * from.y, 1.2 * from.z);
        // The weak springs tilt the column by less than the tolerance of the gap.
        assert!((now.coords - exact).norm() < 1e-3, "{rest} {now} {exact}");
    }
    let (_, force) = report.reactions_n.iter().find(|(s, _)| *s == 2).unwrap();
    let force = Vector::from(*force);
    let pull = stress(low)[(2, 2)] * 36.0;
    assert!((force.dot(&normal) - pull).abs() < 1e-3 * pull, "{force} {pull}");
    assert!((force - normal * force.dot(&normal)).norm() < 1e-4 * pull, "friction: {force}");
}

/// A tube between two cylinders that is stretched along its axis: both surfaces map onto themselves, so the deformation is
/// uniform although both are curved.
#[test]
fn a_tube_that_glides_on_cylinders_is_stretched_uniformly() {
    struct Cylinder(f64, f64);
    impl Implicit for Cylinder {
        fn value(&self, p: &Point) -> f64 {
            self.1 * (p.x.hypot(p.y) - self.0)
        }
        fn value_gradient(&self, p: &Point) -> (f64, Vector) {
            let r = p.x.hypot(p.y).max(1e-12);
            (self.value(p), Vector::new(p.x, p.y, 0.0) * (self.1 / r))
        }
    }
    const LENGTH: f64 = 6.0;
    // x is the angle, y the height, z the radius.
    let mut mesh = Slab { cells: [6, 4, 2], origin: [0.0; 3], size: [0.9, LENGTH, 3.0], skin: 0.0 }.mesh();
    let outer: Vec<[u32; 3]> = crate::mesh::boundary_triangles(&mesh)
        .into_iter()
        .filter(|t| t.iter().all(|n| mesh.positions[*n as usize].z == 3.0))
        .collect();
    mesh.bone_faces.extend(outer);
    let flat = mesh.positions.clone();
    let end = |p: &Point| p.y == 0.0 || p.y == LENGTH;
    let side = |p: &Point| p.x == 0.0 || p.x == 0.9;
    attach(&mut mesh, |p| match p.z {
        0.0 => Some(Attachment::Gliding(1)),
        3.0 => Some(Attachment::Gliding(2)),
        _ => None,
    });
    for p in &mut mesh.positions {
        let r = 5.0 + p.z;
        *p = Point::new(r * p.x.cos(), r * p.x.sin(), p.y);
    }
    let stretch = 1.15;
    let held: Vec<bool> = flat.iter().map(|p| end(p) || side(p)).collect();
    let boundary = Boundary {
        held_axes: held.iter().map(|h| if *h { 7 } else { 0 }).collect(),
        prescribed_mm: (mesh.positions.iter().zip(&held))
            .map(|(p, h)| if *h { Vector::z() * ((stretch - 1.0) * p.z) } else { Vector::zeros() })
            .collect(),
        ..Boundary::default()
    };
    let (inner, outer) = (Cylinder(5.0, 1.0), Cylinder(8.0, -1.0));
    let bodies =
        vec![ContactBody { segment: 1, solid: &inner as &dyn Implicit }, ContactBody { segment: 2, solid: &outer }];
    let settings = SolveSettings {
        relative_residual: 1e-8,
        penetration_tolerance_mm: 1e-4,
        ..SolveSettings::new(Model::Nonlinear, neo_hookean())
    };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, bodies, &boundary, settings, &control).unwrap();
    solver.advance(1.0, &|_| Vec::new(), &control).unwrap();
    for (rest, now) in mesh.positions.iter().zip(solver.positions()) {
        let exact = Point::new(rest.x, rest.y, stretch * rest.z);
        // Flat faces on a curved body: a facet's force is off the normal by up to half its angle, 4 degrees, and moves nodes by
        // that share of the 0.9 mm of stretch.
        assert!((now - exact).norm() < 0.02, "{rest} {now} {exact}");
    }
}

/// Tissue comes off where bone pulls harder than the limit, and only there; bone still pushes it.
#[test]
fn tissue_is_pulled_off_beyond_the_limit_and_still_pushed() {
    let control = Control::new();
    let mesh = gliding_slab(6);
    let solve = |pull_off_mpa: Option<f64>, ends: &[f64]| {
        let settings = SolveSettings { pull_off_mpa, ..SolveSettings::new(Model::Mixed, neo_hookean()) };
        let mut solver = Solver::new(&mesh, body(&Floor), settings, &control).unwrap();
        let mut from = 0.0;
        for (i, end) in ends.iter().enumerate() {
            let (a, b) = (from, *end);
            let t0 = i as f64;
            let motions = move |t: f64| vec![(1, Motion::translation(0.0, 0.0, a + (b - a) * (t - t0)))];
            let report = solver.advance(t0 + 1.0, &motions, &control).unwrap();
            from = b;
            if i + 1 == ends.len() {
                let now = solver.positions();
                let glides = now.iter().zip(&mesh.attachment).filter(|(_, a)| **a == Attachment::Gliding(1));
                let lowest = glides.map(|(p, _)| p.z - b).fold(f64::INFINITY, f64::min);
                return (report.pulled_off, now, lowest);
            }
        }
        unreachable!("there is at least one end")
    };
    let n = mesh.attachment.iter().filter(|a| **a == Attachment::Gliding(1)).count();
    let (held, with_bone, _) = solve(None, &[-2.0]);
    assert_eq!(held, 0);
    assert_eq!(solve(Some(1.0), &[-2.0]).0, 0);
    // Without any suction the bone leaves the tissue, which stays at rest.
    let (off, at_rest, _) = solve(Some(0.0), &[-2.0]);
    assert_eq!(off, n);
    assert!(largest(&at_rest, &mesh.positions) < 1e-3 && largest(&with_bone, &mesh.positions) > 1.9);
    // Pushed again, no node lies deeper than the tolerance.
    let (_, _, lowest) = solve(Some(0.0), &[-2.0, 2.0]);
    assert!(lowest > -0.05, "{lowest}");
    // The limit decides how many come off.
    let part = solve(Some(5e-3), &[-2.0]).0;
    assert!(part > 0 && part <= n, "{part}");
}

/// A share of hold leads from gliding to being tied without a jump.
#[test]
fn hold_blends_gliding_into_being_tied() {
    let control = Control::new();
    let glides = gliding_slab(6);
    let mut tied = glides.clone();
    tied.attachment.iter_mut().filter(|a| **a == Attachment::Gliding(1)).for_each(|a| *a = Attachment::Tied(1));
    let end = Vector::new(2.0, 0.0, 1.0);
    let settings = SolveSettings { relative_residual: 1e-6, ..SolveSettings::new(Model::Mixed, neo_hookean()) };
    let mut reference = Solver::new(&tied, body(&Floor), settings.clone(), &control).unwrap();
    reference.advance(1.0, &path(end), &control).unwrap();
    let at = |share: f64| {
        let boundary = Boundary { tied_share: vec![share; glides.positions.len()], ..Boundary::default() };
        let mut solver = Solver::with_boundary(&glides, body(&Floor), &boundary, settings.clone(), &control).unwrap();
        solver.advance(1.0, &path(end), &control).unwrap();
        solver.positions()
    };
    let off: Vec<f64> = [0.0, 0.25, 0.5, 0.75, 1.0].iter().map(|s| largest(&at(*s), &reference.positions())).collect();
    // Free nodes lag behind by nearly the whole 2 mm; the stiffest hold leaves a twentieth.
    assert!(off.is_sorted_by(|a, b| a > b), "{off:?}");
    assert!(off[0] > 1.2 && off[4] < 0.15, "{off:?}");
    assert!(off.windows(2).all(|w| w[0] - w[1] < 0.6 * off[0]), "{off:?}");
}

/// A block on a foundation: with a Poisson ratio of 0 and small strain, springs in series.
#[test]
fn a_block_on_a_foundation_moves_as_springs_in_series() {
    let mut mesh = Slab { cells: [3, 3, 4], origin: [0.0; 3], size: [6.0, 6.0, 8.0], skin: 0.0 }.mesh();
    attach(&mut mesh, |p| (p.z == 0.0).then_some(Attachment::Tied(1)));
    // Per area, so that the top stays flat: each of its nodes carries its share of the triangles.
    let stiffness = 0.004;
    let mut foundation_n_mm = vec![0.0; mesh.positions.len()];
    for t in crate::mesh::boundary_triangles(&mesh) {
        if t.iter().all(|n| mesh.positions[*n as usize].z == 8.0) {
            let [a, b, c] = t.map(|n| mesh.positions[n as usize]);
            let area = 0.5 * (b - a).cross(&(c - a)).norm();
            t.iter().for_each(|n| foundation_n_mm[*n as usize] += stiffness * area / 3.0);
        }
    }
    let young = 0.05;
    let materials = Materials::homogeneous(Material::neo_hookean(young / 2.0, 0.0));
    let settings = SolveSettings { relative_residual: 1e-10, ..SolveSettings::new(Model::Linear, materials) };
    let boundary = Boundary { foundation_n_mm, ..Boundary::default() };
    let control = Control::new();
    let mut solver = Solver::with_boundary(&mesh, vec![], &boundary, settings, &control).unwrap();
    solver.advance(1.0, &path(Vector::z()), &control).unwrap();
    let of_block = young / 8.0;
    let top = of_block / (of_block + stiffness);
    for (rest, now) in mesh.positions.iter().zip(solver.positions()) {
        let exact = rest + Vector::z() * (1.0 + (top - 1.0) * rest.z / 8.0);
        assert!((now - exact).norm() < 1e-7, "{rest} {now} {exact}");
    }
}

#[test]
fn gliding_on_a_segment_without_a_solid_is_refused() {
    let mesh = gliding_slab(2);
    let settings = SolveSettings::new(Model::Mixed, neo_hookean());
    let error = Solver::new(&mesh, vec![], settings, &Control::new()).unwrap_err();
    assert!(matches!(&error, SolveError::Problem { detail } if detail.contains("glides on segment 1")), "{error}");
}
