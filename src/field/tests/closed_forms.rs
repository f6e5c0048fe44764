use super::shapes::{
    Random, block, block_distance, cone, cone_distance, convex_distance, fields, joined, sphere, tetrahedron, torus,
    torus_distance,
};
use crate::Method;
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

const SPACING_MM: f64 = 0.5;
const BAND_MM: f64 = 2.0;

/// Largest errors allowed in the band for sampled fields and for the adaptive method, in spacings.
///
/// On smooth parts interpolation is off by 3 h²/8r. Where the gradient jumps (edges, tips, the medial axis) a trilinear function
/// is off by at most half a cell's diagonal, 0.87 h, and splines by about 0.4 h.
struct Allowed {
    sampled: f64,
    adaptive: f64,
}

/// Compares every method with `distance` at points of the band, half of them near `focus`.
fn check(mesh: &TriMesh, half: f64, focus: Point, allowed: &Allowed, distance: impl Fn(&Point) -> f64) {
    for (method, field, report) in fields(mesh, SPACING_MM, BAND_MM) {
        assert!(report.regions.is_empty() && report.warnings.is_empty(), "{method:?}: {report:?}");
        let mut random = Random(30);
        let (mut largest, mut at, mut near) = (0.0f64, focus, 0);
        for n in 0..20_000 {
            let p = if n % 2 == 0 { random.point(mesh.bounds().center(), half) } else { random.point(focus, 1.5) };
            let (value, d) = (field.value(&p), distance(&p));
            assert!(value.is_finite());
            if d.abs() <= BAND_MM {
                near += 1;
                if (value - d).abs() > largest {
                    (largest, at) = ((value - d).abs(), p);
                }
            }
        }
        let limit = if method == Method::Adaptive { allowed.adaptive } else { allowed.sampled };
        assert!(near > 4000, "{near}");
        assert!(largest <= limit * SPACING_MM, "{method:?}: {largest} at {at}");
    }
}

#[test]
fn a_sphere() {
    let center = Point::new(0.3, -0.2, 0.1);
    let mesh = sphere(center, 8.0, 5);
    check(&mesh, 11.0, center + Vector::new(8.0, 0.0, 0.0), &Allowed { sampled: 0.08, adaptive: 0.02 }, |p| {
        (p - center).norm() - 8.0
    });
}

#[test]
fn a_box() {
    let (center, half) = (Point::new(0.3, -0.2, 0.1), Vector::new(6.0, 4.0, 5.0));
    check(&block(center, half), 9.0, center + half, &Allowed { sampled: 0.6, adaptive: 0.4 }, |p| {
        block_distance(center, half, p)
    });
}

#[test]
fn a_torus() {
    let center = Point::new(0.3, -0.2, 0.1);
    let mesh = torus(center, 7.0, 3.0, 128);
    check(&mesh, 11.0, center + Vector::new(4.0, 0.0, 0.0), &Allowed { sampled: 0.08, adaptive: 0.04 }, |p| {
        torus_distance(center, 7.0, 3.0, p)
    });
}

#[test]
fn a_plate_of_half_a_millimetre() {
    let (center, half) = (Point::new(0.03, 0.02, 0.11), Vector::new(6.0, 5.0, 0.25));
    check(&block(center, half), 8.0, center + half, &Allowed { sampled: 0.75, adaptive: 0.5 }, |p| {
        block_distance(center, half, p)
    });
}

#[test]
fn the_tip_of_a_cone() {
    // The flat sides lie up to r (1 - cos π/n) = 0.0003 mm inside the round ones.
    let mesh = cone(4.0, 8.0, 256);
    check(&mesh, 8.0, Point::origin(), &Allowed { sampled: 0.75, adaptive: 0.5 }, |p| cone_distance(4.0, 8.0, p));
}

#[test]
fn two_tetrahedra_that_touch_at_a_corner() {
    let o = Point::new(0.07, 0.02, -0.05);
    let at = |x: f64, y: f64, z: f64| o + Vector::new(x, y, z);
    let a = tetrahedron([o, at(6.0, -3.0, -3.0), at(6.0, 4.0, -2.0), at(5.0, 0.0, 4.0)]);
    let b = tetrahedron([o, at(-6.0, -3.0, -3.0), at(-5.0, 0.0, 4.0), at(-6.0, 4.0, -2.0)]);
    assert!(a.volume() > 0.0 && b.volume() > 0.0);
    // The shared corner is stored once.
    let mut triangles = joined(&a, &b).triangles().to_vec();
    triangles.iter_mut().flatten().filter(|v| **v == 4).for_each(|v| *v = 0);
    let mesh = TriMesh::new(joined(&a, &b).positions().to_vec(), triangles).unwrap();
    let distance = |p: &Point| convex_distance(&a, p).min(convex_distance(&b, p));
    check(&mesh, 8.0, o, &Allowed { sampled: 0.75, adaptive: 0.5 }, distance);
}
