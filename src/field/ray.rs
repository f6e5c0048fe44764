//! Crossings of a triangle with a ray along -x.

use prosopon_geometry::Point;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// Whether a point lies left of the line through `a` and `b`; points on it are shifted by (ε, ε²).
pub(super) fn is_left(orientation: f64, a: Coord<f64>, b: Coord<f64>) -> bool {
    if orientation != 0.0 {
        return orientation > 0.0;
    }
    if a.y == b.y { b.x > a.x } else { b.y < a.y }
}

/// Contribution of a triangle to the winding number of `p`, counted along the ray from `p` along -x.
pub(super) fn winding_before(p: &Point, corners: &[Point; 3]) -> i32 {
    let [a, b, c] = corners.map(|q| Coord { x: q.y, y: q.z });
    let area = orient2d(a, b, c);
    let at = Coord { x: p.y, y: p.z };
    let positive = area > 0.0;
    let sides = [(b, c), (c, a), (a, b)];
    if area == 0.0 || sides.iter().any(|&(from, to)| is_left(orient2d(from, to, at), from, to) != positive) {
        return 0;
    }
    let [a, b, c] = corners.map(|q| Coord3D { x: q.x, y: q.y, z: q.z });
    let below = orient3d(a, b, c, Coord3D { x: p.x, y: p.y, z: p.z });
    match (positive, below < 0.0, below > 0.0) {
        (true, true, _) => -1,
        (false, _, true) => 1,
        _ => 0,
    }
}
