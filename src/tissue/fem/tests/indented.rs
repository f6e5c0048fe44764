//! Rigid bodies pressed into blocks, against finer independent solutions; the finest meshes run only with `SLOW_TESTS`.

use super::blocks::{Slab, attach};
use super::bodies::{Ball, RoundedPost};
use crate::fem::material::{Material, Materials};
use crate::fem::{Boundary, ContactBody, Locking, Model, SkinElement, SolveSettings, Solver, StepReport};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector};

/// Penetration tolerance under the post, mm: a five hundredth of its height.
const PENETRATION_MM: f64 = 0.01;

fn slow() -> bool {
    std::env::var_os("SLOW_TESTS").is_some()
}

fn up(d: f64) -> impl Fn(f64) -> Vec<(u32, Motion)> {
    move |t| vec![(1, Motion::translation(0.0, 0.0, d * t))]
}

/// Boundary with planes of symmetry x = 0 and y = 0.
fn quarter(mesh: &MixedMesh) -> Boundary {
    let held = |p: &Point| u8::from(p.x.abs() < 1e-9) + 2 * u8::from(p.y.abs() < 1e-9);
    Boundary { held_axes: mesh.positions.iter().map(held).collect(), ..Boundary::default() }
}

/// The layered block of the references: a quarter of 120 x 120 x 16.5 mm, whose uppermost 1.5 mm are skin, with a post of 40 x 40
/// mm with edges rounded by 5 mm below it. Returns displacements of the middle of the skin at each of `heights` of the post, and
/// the last report.
fn layered_block(
    cells: [usize; 3],
    locking: Locking,
    skin_element: SkinElement,
    stiffness: f64,
    heights: &[f64],
) -> (Vec<Vec<Vector>>, StepReport) {
    let mut mesh = Slab { cells, origin: [0.0; 3], size: [60.0, 60.0, 15.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let r = p.x.max(p.y);
        match p.z == 0.0 {
            _ if r > 60.0 - 1e-6 => Some(Attachment::Fixed),
            true if r >= 30.0 - 1e-6 => Some(Attachment::Fixed),
            true => Some(Attachment::Sliding),
            false => None,
        }
    });
    let material = |mu: f64| Material::mooney_rivlin(0.4 * mu, 0.1 * mu, 0.45);
    let (skin, fat) = (material(0.070142923), material(0.011776447));
    let settings = SolveSettings {
        skin_element,
        locking,
        penetration_tolerance_mm: PENETRATION_MM,
        contact_stiffness_factor: stiffness,
        ..SolveSettings::new(Model::Nonlinear, Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat })
    };
    let post = RoundedPost { half_width: 20.0, edge_radius: 5.0 };
    let control = Control::new();
    let bodies = vec![ContactBody { segment: 1, solid: &post }];
    let mut solver = Solver::with_boundary(&mesh, bodies, &quarter(&mesh), settings, &control).unwrap();
    let top = |x: f64| mesh.positions.iter().position(|p| (p - Point::new(x, 0.0, 16.5)).norm() < 1e-6).unwrap();
    let mut lines = Vec::new();
    let mut last = None;
    let end = heights[heights.len() - 1];
    for height in heights {
        last = Some(solver.advance(height / end, &up(end), &control).unwrap());
        let now = solver.positions();
        lines.push([0.0, 20.0, 30.0].map(|x| now[top(x)] - mesh.positions[top(x)]).to_vec());
    }
    (lines, last.unwrap())
}

/// Reference: hexahedra of degree 2 (`e_3d_contact_nu45.csv`, level 2), which changed by 0.1 to 0.8 % from the level before.
/// Standard linear tetrahedra with this spacing are 5 to 23 % off.
#[test]
fn a_layered_block_over_a_post_is_as_in_an_independent_solution() {
    if !slow() {
        return;
    }
    let expected = [[4.9897, 3.0963, 0.9065, 0.9811]];
    for (name, locking, skin_element, within) in [
        ("tet, smoothed", Locking::Smoothed, SkinElement::Tetrahedron, 0.02),
        // The skin bends over the rim in two rows of wedges, which are a little stiffer there.
        ("wedge, smoothed", Locking::Smoothed, SkinElement::Wedge, 0.025),
        // A patch is wider than an edge: at the rim of the post it averages over half of the rounding.
        ("tet, patched", Locking::Patched, SkinElement::Tetrahedron, 0.03),
        ("wedge, patched", Locking::Patched, SkinElement::Wedge, 0.03),
    ] {
        let (lines, report) = layered_block([24, 24, 6], locking, skin_element, 1.0, &[2.5, 5.0]);
        let found = [lines[1][0].z, lines[1][1].z, lines[1][1].x, lines[1][2].z];
        let force = 1e3 * report.reactions_n.iter().find(|(s, _)| *s == 1).unwrap().1[2];
        println!("layered block, {name}: uz(0), uz(20), ux(20), uz(30) {found:.4?}, force {force:.1} mN, {report:?}");
        for (found, expected) in found.iter().zip(expected[0]) {
            assert!((found / expected - 1.0).abs() < within, "{name}: {found} {expected}");
        }
        assert!((force / 1509.0 - 1.0).abs() < within, "{name}: {force}");
        assert!(report.max_penetration_mm <= PENETRATION_MM);
    }
}

/// The same post, twice as high: `e_3d_contact_nu45.csv`, level 2, d = 10 mm; the force is that of level 1, as level 2 has none.
/// From level 1 to 2 the displacements changed by up to 0.8 %.
#[test]
fn a_post_of_ten_millimetres_is_as_in_an_independent_solution() {
    if !slow() {
        return;
    }
    let expected = [9.4018, 6.1807, 1.9021, 2.1495];
    for (name, locking, skin_element, within) in [
        ("tet, smoothed", Locking::Smoothed, SkinElement::Tetrahedron, 0.02),
        ("wedge, smoothed", Locking::Smoothed, SkinElement::Wedge, 0.025),
        // A patch is wider than an edge: at the rim of the post it averages over half of the rounding.
        ("tet, patched", Locking::Patched, SkinElement::Tetrahedron, 0.03),
        ("wedge, patched", Locking::Patched, SkinElement::Wedge, 0.03),
    ] {
        let (lines, report) = layered_block([24, 24, 6], locking, skin_element, 1.0, &[2.5, 5.0, 7.5, 10.0]);
        let found = [lines[3][0].z, lines[3][1].z, lines[3][1].x, lines[3][2].z];
        let force = 1e3 * report.reactions_n.iter().find(|(s, _)| *s == 1).unwrap().1[2];
        println!("post of 10 mm, {name}: uz(0), uz(20), ux(20), uz(30) {found:.4?}, force {force:.1} mN, {report:?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < within, "{name}: {found} {expected}");
        }
        assert!((force / 3335.8 - 1.0).abs() < within, "{name}: {force}");
        assert!(report.max_penetration_mm <= PENETRATION_MM);
    }
}

/// Multipliers make the result independent of the penalty stiffness.
#[test]
fn a_stiffer_contact_gives_the_same_answer() {
    let height = |stiffness: f64| {
        let (lines, report) = layered_block([12, 12, 3], Locking::Smoothed, SkinElement::Wedge, stiffness, &[2.5, 5.0]);
        assert!(report.max_penetration_mm <= PENETRATION_MM);
        lines[1][0].z
    };
    let (plain, stiff) = (height(1.0), height(10.0));
    println!("penalty times ten: {plain} {stiff}");
    assert!((stiff / plain - 1.0).abs() < 1e-3, "{plain} {stiff}");
}

/// A ball of radius 10 mm pressed into a quarter of a block of radius 40 mm, `n` cells a side, fine near the contact.
fn hertz(n: usize, depth: f64, locking: Locking) -> f64 {
    let mut mesh = Slab { cells: [n; 3], origin: [0.0; 3], size: [1.0; 3], skin: 0.0 }.mesh();
    for p in &mut mesh.positions {
        // Equal cells over about four contact radii, then growing ones.
        let grade = |s: f64| 8.0 * s + 32.0 * s.powi(4);
        *p = Point::new(grade(p.x), grade(p.y), grade(p.z));
    }
    attach(&mut mesh, |p| match p.z {
        z if z > 39.9 => Some(Attachment::Fixed),
        0.0 => Some(Attachment::Sliding),
        _ => None,
    });
    let ball = Ball { centre: Point::new(0.0, 0.0, -10.0), radius: 10.0 };
    let settings = SolveSettings {
        penetration_tolerance_mm: 0.001,
        locking,
        ..SolveSettings::new(Model::Nonlinear, Materials::homogeneous(Material::neo_hookean(0.011776447, 0.45)))
    };
    let control = Control::new();
    let bodies = vec![ContactBody { segment: 1, solid: &ball }];
    let mut solver = Solver::with_boundary(&mesh, bodies, &quarter(&mesh), settings, &control).unwrap();
    let report = solver.advance(1.0, &up(depth), &control).unwrap();
    4e3 * report.reactions_n.iter().find(|(s, _)| *s == 1).unwrap().1[2]
}

/// `d_hertz.csv`: 66.40 mN at half a millimetre (dolfinx, axisymmetric, radius 40 mm; a square block differs by less than the
/// tolerance).
#[test]
fn a_ball_is_pressed_in_with_the_force_of_an_independent_solution() {
    let cells: &[usize] = if slow() { &[10, 14, 20] } else { &[10] };
    for &n in cells {
        for locking in [Locking::Smoothed, Locking::Patched] {
            let force = hertz(n, 0.5, locking);
            println!("Hertz, {n} cells a side, {locking:?}: {force:.2} mN");
            assert!((force / 66.40 - 1.0).abs() < 0.02, "{n}, {locking:?}: {force}");
        }
    }
}
