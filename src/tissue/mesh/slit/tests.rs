//! Meshes of a face whose lips part.

use super::super::test_domain::Shape;
use super::super::test_invariants::{measure, no_node_hangs};
use super::super::tuning::WORST_JACOBIAN;
use super::super::{Domain, MeshReport, MeshSettings, MixedMesh, Region, build, build_parted};
use super::{Slit, SlitKnot};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Point};

const HALF_WIDTH: f64 = 22.0;

fn region() -> Region {
    let bounds = Aabb { min: Point::new(-42.0, -120.0, -72.0), max: Point::new(42.0, -30.0, -6.0) };
    Region { bounds, half_spaces: vec![] }
}

/// First point from in front at (x, z) with a value below 0.
fn first(solid: &dyn Implicit, x: f64, z: f64) -> f64 {
    (0..2000).map(|i| -120.0 + 0.05 * f64::from(i)).find(|y| solid.value(&Point::new(x, *y, z)) < 0.0).unwrap()
}

fn height(x: f64) -> f64 {
    -38.0 - 0.003 * x * x
}

/// The slit along the groove of the head's skin, back to its bone.
fn slit(skin: &dyn Implicit, bone: &dyn Implicit) -> Slit {
    let knot = |i: i32| {
        let x = HALF_WIDTH * f64::from(i) / 10.0;
        SlitKnot { front: Point::new(x, first(skin, x, height(x)), height(x)), back_y: first(bone, x, height(x)) }
    };
    Slit::new((-10..=10).map(knot).collect()).unwrap()
}

fn meshed(edge_mm: f64, parts: bool) -> (Slit, MixedMesh, MeshReport) {
    let (skin, bone, region) = (Shape::head_skin(), Shape::head_bone(), region());
    let slit = slit(&skin, &bone);
    let domain = Domain { skin: &skin, bone: &bone, air: None, soft_tissue: None, region: &region };
    let settings = MeshSettings { edge_mm, ..MeshSettings::default() };
    let (mesh, report) = build_parted(&domain, parts.then_some(&slit), &settings, &Control::new()).unwrap();
    (slit, mesh, report)
}

fn area(mesh: &MixedMesh, triangles: &[[u32; 3]]) -> f64 {
    let one = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|n| mesh.positions[n as usize]);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    triangles.iter().map(one).sum()
}

/// Area of the slit from its rounded edge to the bone, mm².
fn slit_area(slit: &Slit, less_mm: f64) -> f64 {
    const N: i32 = 2000;
    let [right, left] = slit.span();
    let h = (left - right) / f64::from(N);
    let at = |i: i32| {
        let x = right + (f64::from(i) + 0.5) * h;
        h * (slit.back_y(x) - slit.front_y(x) - less_mm) * slit.surface_z(x).1.hypot(1.0)
    };
    (0..N).map(at).sum()
}

#[test]
fn lips_are_meshed_apart() {
    for edge in [4.0, 3.0] {
        let (slit, mesh, report) = meshed(edge, true);
        let name = format!("lips, edge {edge}");
        let found = measure(&name, &mesh);
        println!("{name}: {report:?}\n{found:?}");
        let [upper, lower] = &mesh.facing[0].sides;
        worst(&mesh);
        for side in &mesh.facing[0].sides {
            coverage(&slit, &mesh, side);
        }
        println!(
            "{} {} area {} {} of {}",
            upper.len(),
            lower.len(),
            area(&mesh, upper),
            area(&mesh, lower),
            slit_area(&slit, 0.0)
        );
    }
}

fn worst(mesh: &MixedMesh) {
    let mut all: Vec<(f64, Point)> = mesh
        .tetrahedra
        .iter()
        .map(|t| {
            let p = t.map(|i| mesh.positions[i as usize]);
            let c = p.iter().fold(Point::origin(), |s, q| s + q.coords * 0.25);
            (super::super::quality::smallest_sine(&p), c)
        })
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (s, c) in all.iter().take(25) {
        println!("{s:.3} at {:.1} {:.1} {:.1}", c.x, c.y, c.z);
    }
    println!(
        "below .1 {} below .18 {}",
        all.iter().filter(|a| a.0 < 0.1).count(),
        all.iter().filter(|a| a.0 < 0.18).count()
    );
}

fn coverage(slit: &Slit, mesh: &MixedMesh, side: &[[u32; 3]]) {
    let mut out = String::new();
    for j in 0..15 {
        for i in 0..48 {
            let x = -23.5 + f64::from(i);
            let y = slit.front_y(x) + 0.5 + f64::from(j);
            let inside = side.iter().any(|t| {
                let [a, b, c] = t.map(|n| mesh.positions[n as usize]);
                let cr = |p: &Point, q: &Point| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
                let s = [cr(&a, &b), cr(&b, &c), cr(&c, &a)];
                s.iter().all(|v| *v >= 0.0) || s.iter().all(|v| *v <= 0.0)
            });
            let is_slit = y < slit.back_y(x) && x.abs() < 22.0;
            out.push(match (inside, is_slit) {
                (true, true) => '#',
                (true, false) => '+',
                (false, true) => '.',
                _ => ' ',
            });
        }
        out.push('\n');
    }
    println!("{out}");
}
