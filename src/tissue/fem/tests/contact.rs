//! Contact: derivatives, patch test, Hertz, and unilateral behaviour.

use super::blocks::{Slab, attach};
use super::bodies::{Ball, Coin, Floor, RoundedPost};
use crate::fem::contact::{Contact, Placement};
use crate::fem::dot::dot;
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, ContactBody, Model, Prepared, Preset, SkinElement, SolveError, SolveSettings, Solver};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, Severity, Vector};

fn up(d: f64) -> impl Fn(f64) -> Vec<(u32, Motion)> {
    move |t| vec![(1, Motion::translation(0.0, 0.0, d * t))]
}

/// A slab whose bottom slides, with the rim fixed.
fn sliding_slab(cells: usize) -> MixedMesh {
    let mut mesh =
        Slab { cells: [cells, cells, 2], origin: [-15.0, -15.0, 0.0], size: [30.0, 30.0, 8.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let rim = p.x.abs() > 14.9 || p.y.abs() > 14.9;
        if rim { Some(Attachment::Fixed) } else { (p.z == 0.0).then_some(Attachment::Sliding) }
    });
    mesh
}

#[test]
fn forces_and_stiffness_with_contact_are_derivatives_of_the_energy() {
    let mesh = sliding_slab(4);
    let control = Control::new();
    let ball = Ball { centre: Point::new(2.0, -1.0, -100.0), radius: 100.0 };
    let floor_and_ball: [&dyn Implicit; 2] = [&Floor, &ball];
    for (skin_element, solid) in [SkinElement::Wedge, SkinElement::C1Prism].into_iter().zip(floor_and_ball) {
        let settings = SolveSettings { skin_element, ..SolveSettings::new(Model::Mixed, Preset::Wang2009.materials()) };
        let bodies = vec![ContactBody { segment: 1, solid }];
        let mut solver = Solver::new(&mesh, bodies, settings, &control).unwrap();
        let equations = &mut solver.equations;
        let motions = [Motion::new(Vector::new(0.0, 0.0, 0.3), Vector::new(0.05, -0.02, 0.0))];
        let n = 3 * equations.problem.dofs().n_unknown();
        let noise = |seed: f64| -> Vec<f64> { (0..n).map(|i| (seed * (i as f64 + 1.0)).sin()).collect() };
        let mut x = equations.problem.dofs().rest().to_vec();
        equations.problem.dofs().add(0.05, &noise(1.3), &mut x);
        let balance = equations.balance(&x, &motions).unwrap();
        assert!(balance.contacts.len() > 10);
        // With multipliers all terms of the energy are present.
        equations.state.contact.augment(&balance.contacts);
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
        let slope = dot(equations.work.residual(), &d);
        // Central differences have errors of order h² and 1e-16/h.
        assert!(((after - before) / (2.0 * h) - slope).abs() < 1e-6 * slope.abs(), "{slope}");
        equations.stiffness(&x, &contacts, &motions).unwrap();
        let mut kd = vec![0.0; n];
        equations.work.multiply(&equations.problem, &d, &mut kd);
        let scale = dot(&kd, &kd).sqrt();
        let error: f64 = (0..n).map(|i| ((r1[i] - r0[i]) / (2.0 * h) - kd[i]).powi(2)).sum::<f64>().sqrt() / scale;
        assert!(error < 1e-6, "{error:.2e}");
    }
}

#[test]
fn a_flat_body_presses_a_flat_block_uniformly() {
    // Poisson ratio 0 and small strain: pressure E d / H everywhere, no lateral movement.
    let mut mesh = Slab { cells: [4, 3, 3], origin: [0.0; 3], size: [8.0, 6.0, 5.0], skin: 0.0 }.mesh();
    attach(&mut mesh, |p| match p.z {
        0.0 => Some(Attachment::Sliding),
        5.0 => Some(Attachment::Fixed),
        _ => None,
    });
    let materials = Materials::homogeneous(Material::neo_hookean(0.01, 0.0));
    let settings = SolveSettings { relative_residual: 1e-9, ..SolveSettings::new(Model::Linear, materials) };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &Floor }], settings, &control).unwrap();
    let report = solver.advance(1.0, &up(1.0), &control).unwrap();
    assert!(report.max_penetration_mm <= 0.05 && report.max_penetration_mm > 0.0);
    let d = 1.0 - report.max_penetration_mm;
    for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
        let expected = Vector::new(0.0, 0.0, d * (5.0 - rest.z) / 5.0);
        assert!((now - rest - expected).norm() < 1e-6, "{:?}", now - rest);
    }
    let force = report.reactions_n[0].1;
    assert!((force[2] - 0.02 * d / 5.0 * 48.0).abs() < 1e-7 && force[0].abs() < 1e-7, "{force:?}");
}

/// Force (N) of a ball of radius 10 mm pressed 0.5 mm into a block of 80 × 80 × 40 mm, with `2 n`, `2 n` and `n` cells that are
/// fine near the contact.
fn indentation_force(n: usize) -> f64 {
    let mut mesh =
        Slab { cells: [2 * n, 2 * n, n], origin: [-1.0, -1.0, 0.0], size: [2.0, 2.0, 1.0], skin: 0.0 }.mesh();
    for p in &mut mesh.positions {
        let grade = |s: f64| 4.0 * s + 36.0 * s * s.abs().powi(3);
        *p = Point::new(grade(p.x), grade(p.y), grade(p.z));
    }
    attach(&mut mesh, |p| match p.z {
        z if z > 39.9 => Some(Attachment::Fixed),
        0.0 => Some(Attachment::Sliding),
        _ => None,
    });
    let ball = Ball { centre: Point::new(0.0, 0.0, -10.0), radius: 10.0 };
    let materials = Materials::homogeneous(Material::neo_hookean(0.011776447, 0.3));
    let settings = SolveSettings { penetration_tolerance_mm: 0.002, ..SolveSettings::new(Model::Mixed, materials) };
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &ball }], settings, &control).unwrap();
    let report = solver.advance(1.0, &up(0.5), &control).unwrap();
    assert!(report.max_penetration_mm <= 0.002);
    report.reactions_n[0].1[2]
}

#[test]
fn indentation_by_a_ball_converges_with_order_two_to_the_independent_reference() {
    // `d_hertz.csv` of the project's reference results (dolfinx, axisymmetric, radius 40 mm): 53.22 mN. Linear tetrahedra are too
    // stiff, by 49, 22 and 12 % with n = 6, 9 and 12: second order, so two meshes extrapolate to the reference.
    let (coarse, fine) = (indentation_force(6), indentation_force(8));
    let limit = (fine * 64.0 - coarse * 36.0) / 28.0;
    assert!((limit / 0.05322 - 1.0).abs() < 0.03, "{coarse} {fine} {limit}");
    assert!(fine < coarse && fine > 0.05322);
}

#[test]
fn sliding_tissue_is_pushed_but_not_pulled_and_tied_tissue_is_pulled() {
    let mut mesh = sliding_slab(6);
    let control = Control::new();
    let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
    let top = mesh.positions.iter().position(|p| (p - Point::new(0.0, 0.0, 9.5)).norm() < 1e-9).unwrap();
    let bottom = top - 3;
    assert!(mesh.positions[bottom].coords.norm() < 1e-9);
    let ball = Ball { centre: Point::new(0.0, 0.0, -10.0), radius: 10.0 };
    let body = ContactBody { segment: 1, solid: &ball };
    let mut solver = Solver::new(&mesh, vec![body], settings.clone(), &control).unwrap();
    // Down and up: only the part of the path above rest moves the tissue.
    let report = solver.advance(0.5, &up(-4.0), &control).unwrap();
    assert_eq!((report.active_contacts, report.reactions_n[0].1), (0, [0.0; 3]));
    assert!(solver.positions()[bottom].z.abs() < 1e-12);
    let report = solver.advance(1.0, &|t| up(-4.0 + 16.0 * (t - 0.5))(1.0), &control).unwrap();
    assert!(report.active_contacts > 0 && report.max_penetration_mm <= 0.05, "{report:?}");
    assert!(report.substeps >= 3 && report.reactions_n[0].1[2] > 0.0);
    // Contact acts on faces too, so the ball's apex need not reach a node on a mesh as coarse as this.
    assert!((3.95..5.0).contains(&solver.positions()[bottom].z), "{}", solver.positions()[bottom].z);
    assert!(solver.positions()[top].z > 9.5 + 1.0);

    mesh.attachment[bottom] = Attachment::Tied(1);
    let mut solver = Solver::new(&mesh, vec![body], settings, &control).unwrap();
    let report = solver.advance(1.0, &up(-1.0), &control).unwrap();
    assert!((solver.positions()[bottom].z + 1.0).abs() < 1e-12);
    assert!(solver.positions()[top].z < 9.5 - 0.01);
    assert!(report.reactions_n[0].1[2] < 0.0);
}

/// Bone is thinner than the longest substep: shorter substeps stop a point that would come out below it, and where they are not
/// allowed the error names the passage.
#[test]
fn tissue_does_not_pass_through_thin_bone() {
    let mesh = sliding_slab(6);
    let control = Control::new();
    let coin = Coin { radius: 8.0, half_thickness: 0.3 };
    let solver = |min_substep: f64| {
        let settings = SolveSettings::new(Model::Nonlinear, Preset::Wang2009Stable.materials());
        let settings = SolveSettings { min_substep, ..settings };
        Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &coin }], settings, &control).unwrap()
    };
    let mut free = solver(1.0 / 256.0);
    let report = free.advance(1.0, &up(4.0), &control).unwrap();
    assert!(report.active_contacts > 0, "{report:?}");
    for (now, rest) in free.positions().iter().zip(&mesh.positions) {
        // A point above the coin at rest is above it after the path, except for the allowed penetration.
        if rest.z == 0.0 && rest.x.hypot(rest.y) < 7.0 {
            assert!(now.z > 4.0 - 0.06, "{now}");
        }
    }
    let mut held = solver(0.5);
    match held.advance(1.0, &up(4.0), &control) {
        Err(SolveError::PassedThrough { segment: 1, .. }) => assert!(held.path_parameter() < 1.0),
        other => panic!("{other:?}"),
    }
}

/// Beside the edge of a coin a point that changes sides went round the rim; in the middle it passed through. Two such points
/// are both found.
#[test]
fn a_path_round_a_rim_is_distinguished_from_one_through_bone() {
    let mesh = sliding_slab(6);
    let coin = Coin { radius: 8.0, half_thickness: 0.3 };
    let (contact, _) = Contact::new(&mesh, vec![ContactBody { segment: 1, solid: &coin }], 1.0);
    let still = [Motion::identity()];
    // All other nodes are far above; the coin lies between z = -0.6 and 0.
    let away = vec![Vector::new(0.0, 0.0, 90.0); mesh.positions.len()];
    let (above, below) = (0.05, -0.75);
    let nodes: Vec<usize> = (0..mesh.positions.len()).filter(|n| mesh.attachment[*n] == Attachment::Sliding).collect();
    let moved = |paths: &[(usize, Vector, Vector)]| {
        let (mut from, mut to) = (away.clone(), away.clone());
        for (node, a, b) in paths {
            (from[*node], to[*node]) = (*a, *b);
        }
        contact.passages(
            Placement { x: &from, motions: &still },
            Placement { x: &to, motions: &still },
            &Control::new(),
        )
    };
    let rim = (nodes[0], Vector::new(7.85, 0.0, above), Vector::new(8.15, 0.0, below));
    let middle = (nodes[9], Vector::new(0.0, 0.0, above), Vector::new(0.0, 0.0, below));
    let beside = (nodes[0], Vector::new(8.3, 0.0, above), Vector::new(8.3, 0.0, below));
    let kinds = |paths: &[(usize, Vector, Vector)]| moved(paths).iter().map(|p| p.round_a_rim).collect::<Vec<bool>>();
    // Only a vertex: barycentres have corners far above.
    assert_eq!(kinds(&[rim]), [true]);
    assert_eq!(kinds(&[middle]), [false]);
    assert_eq!(kinds(&[rim, middle]).len(), 2);
    assert!(kinds(&[beside]).is_empty());
}

#[test]
fn overlap_at_rest_is_stress_free_and_reported() {
    let mesh = sliding_slab(6);
    let control = Control::new();
    let ball = Ball { centre: Point::new(0.0, 0.0, -9.7), radius: 10.0 };
    let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
    let mut solver = Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &ball }], settings, &control).unwrap();
    let report = solver.advance(0.0, &up(1.0), &control).unwrap();
    let overlap = report.warnings.iter().find(|w| w.code == "overlap-at-rest").unwrap();
    assert!(overlap.severity == Severity::Info && overlap.message.contains("0.1 to 0.30 mm"), "{overlap}");
    for (now, rest) in solver.positions().iter().zip(&mesh.positions) {
        assert!((now - rest).norm() < 1e-9);
    }
}

/// A post raised by the second field, mm.
struct Raised(RoundedPost, f64);

impl Implicit for Raised {
    fn value(&self, p: &Point) -> f64 {
        self.0.value(&(p - Vector::z() * self.1))
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        self.0.value_gradient(&(p - Vector::z() * self.1))
    }
}

/// A spine of bone penetrates a face between its nodes: the nearest surface is at its side, but tissue lies on its tip.
#[test]
fn overlap_within_thin_bone_is_pushed_towards_the_tissue() {
    let mesh = sliding_slab(6);
    let middle = |face: &[u32; 3]| face.iter().map(|n| mesh.positions[*n as usize].coords).sum::<Vector>() / 3.0;
    let at = mesh.bone_faces.iter().map(middle).find(|m| m.x.hypot(m.y) < 4.0).unwrap();
    let spine = Raised(RoundedPost { half_width: 0.5, edge_radius: 0.1 }, 1.0);
    let body = ContactBody { segment: 1, solid: &spine };
    let still = Motion::translation(at.x - 0.2, at.y, 0.0);
    // The spine is at the middle of that face at rest.
    let moved: Vec<Point> = mesh.positions.iter().map(|p| still.inverse_transform_point(p)).collect();
    let mesh = MixedMesh { positions: moved, ..mesh };
    let (contact, _) = Contact::new(&mesh, vec![body], 1.0);
    let x: Vec<Vector> = mesh.positions.iter().map(|p| p.coords).collect();
    assert!(contact.active_contacts(&x, &[Motion::identity()]).is_empty());
    let contacts = contact.active_contacts(&x, &[Motion::translation(0.0, 0.0, 0.1)]);
    // The nodes of the face are farther away than the spine is wide.
    let [pair] = contacts.as_slice() else { panic!("{contacts:?}") };
    // The search for the surface is accurate to 0.01 mm.
    assert!((pair.gap() + 0.1).abs() < 0.011, "{pair:?}");
    let mut forces = vec![Vector::zeros(); x.len()];
    contact.add_forces(&contacts, &mut forces);
    let total: Vector = forces.iter().sum();
    assert!(total.z < 0.0 && total.x.abs() + total.y.abs() < 1e-9 * -total.z, "{total}");
}

/// Edges of bone rise under rows of nodes, which may slip to either side. Contact is solved along the path, so one long step ends
/// where eight short ones do, within twice the penetration tolerance.
#[test]
fn a_long_step_ends_where_short_ones_do_at_an_edge() {
    let mut mesh = Slab { cells: [12, 12, 3], origin: [-24.0, -24.0, 0.0], size: [48.0, 48.0, 12.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let r = p.x.abs().max(p.y.abs());
        let fixed = r > 23.9 || (p.z == 0.0 && r >= 16.0);
        if fixed { Some(Attachment::Fixed) } else { (p.z == 0.0).then_some(Attachment::Sliding) }
    });
    let control = Control::new();
    let post = RoundedPost { half_width: 12.0, edge_radius: 0.5 };
    let end = |steps: u32| {
        let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
        let mut solver =
            Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &post }], settings, &control).unwrap();
        for k in 1..=steps {
            solver.advance(f64::from(k) / f64::from(steps), &up(8.0), &control).unwrap();
        }
        solver.positions()
    };
    let (long, short) = (end(1), end(8));
    let outer = mesh.prisms.iter().flat_map(|p| &p[..3]).map(|n| *n as usize);
    let off = outer.map(|n| (long[n] - short[n]).norm()).fold(0.0, f64::max);
    assert!(off < 0.1, "{off}");
}

/// The energy of linear tissue equals the quadratic model of the condensed contact solve, so one model finds the equilibrium over
/// a curved body, up to the error of single precision.
#[test]
fn contact_of_linear_tissue_is_solved_at_once_over_a_curved_body() {
    let mesh = sliding_slab(8);
    let control = Control::new();
    let ball = Ball { centre: Point::new(1.0, 0.5, -10.0), radius: 10.0 };
    let settings = SolveSettings::new(Model::Linear, Preset::Wang2009Stable.materials());
    let mut solver = Solver::new(&mesh, vec![ContactBody { segment: 1, solid: &ball }], settings, &control).unwrap();
    let report = solver.advance(1.0, &up(1.5), &control).unwrap();
    assert!(report.active_contacts >= 4 && report.newton_iterations <= 1, "{report:?}");
    assert_eq!((report.substeps, report.factorisations), (1, 1));
}

#[test]
fn a_solver_over_a_shared_preparation_has_the_bits_of_one_with_its_own() {
    let mesh = sliding_slab(6);
    let control = Control::new();
    let ball = Ball { centre: Point::new(0.0, 0.0, -10.0), radius: 10.0 };
    let body = ContactBody { segment: 1, solid: &ball };
    let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
    let prepared = Prepared::new(&mesh, &[body], &Boundary::default(), settings.clone(), &control).unwrap();
    let over = |d: f64| {
        let mut solver = Solver::over(&prepared, &mesh, vec![body], &control).unwrap();
        let report = solver.advance(1.0, &up(d), &control).unwrap();
        (solver.positions(), report.factorisations)
    };
    over(2.0);
    let (shared, made) = over(1.0);
    let mut solver = Solver::new(&mesh, vec![body], settings, &control).unwrap();
    let report = solver.advance(1.0, &up(1.0), &control).unwrap();
    assert_eq!(solver.positions(), shared);
    assert_eq!(report.factorisations, made + 1);
    assert!(Solver::over(&prepared, &sliding_slab(5), vec![body], &control).is_err());
}
