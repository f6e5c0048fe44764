//! Exact intersection tests of two triangles.

use robust::{Coord, Coord3D, orient2d, orient3d};

use super::Point;

/// Whether the closed triangles `a` and `b` have a point in common.
///
/// The caller handles triangles that share vertices. Exact for the given coordinates (Shewchuk's adaptive predicates). A
/// triangle without area counts as its three sides.
pub(super) fn triangles_meet(a: &[Point; 3], b: &[Point; 3]) -> bool {
    // Two triangles meet only where a side of one meets the other.
    (0..3).any(|i| segment_meets(&a[i], &a[(i + 1) % 3], b) || segment_meets(&b[i], &b[(i + 1) % 3], a))
}

/// Whether the closed segment from `p` to `q` and the closed triangle have a point in common.
pub(super) fn segment_meets(p: &Point, q: &Point, triangle: &[Point; 3]) -> bool {
    let [a, b, c] = triangle;
    let (above, below) = (side(a, b, c, p), side(a, b, c, q));
    if above * below > 0.0 {
        return false;
    }
    if above == 0.0 && below == 0.0 {
        return coplanar_segment_meets(p, q, triangle);
    }
    // The line through p and q crosses the triangle when it passes all three sides on the same side.
    let turns = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
}

/// Sign of the volume of the tetrahedron: -1, 0 or 1, so that products of signs do not underflow.
fn side(a: &Point, b: &Point, c: &Point, d: &Point) -> f64 {
    let coord = |p: &Point| Coord3D { x: p.x, y: p.y, z: p.z };
    sign(orient3d(coord(a), coord(b), coord(c), coord(d)))
}

fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// [`segment_meets`] for a coplanar segment, projected along the largest component of the triangle's normal.
fn coplanar_segment_meets(p: &Point, q: &Point, triangle: &[Point; 3]) -> bool {
    let [a, b, c] = triangle;
    let normal = (b - a).cross(&(c - a));
    // A triangle whose corners lie on a line has no normal: the segment meets it when all three projections do.
    if normal.iter().all(|x| *x == 0.0) {
        return (0..3).all(|axis| planar_segment_meets(p, q, triangle, axis));
    }
    planar_segment_meets(p, q, triangle, normal.iamax())
}

fn planar_segment_meets(p: &Point, q: &Point, triangle: &[Point; 3], axis: usize) -> bool {
    let flat = |p: &Point| Coord { x: p[(axis + 1) % 3], y: p[(axis + 2) % 3] };
    let (p, q) = (flat(p), flat(q));
    let corners = triangle.map(|c| flat(&c));
    let inside = |p: Coord<f64>| {
        let turns = [0, 1, 2].map(|i| orient2d(corners[i], corners[(i + 1) % 3], p));
        let flat_triangle = orient2d(corners[0], corners[1], corners[2]) == 0.0;
        !flat_triangle && (turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0))
    };
    inside(p) || inside(q) || (0..3).any(|i| segments_meet(p, q, corners[i], corners[(i + 1) % 3]))
}

fn segments_meet(a: Coord<f64>, b: Coord<f64>, c: Coord<f64>, d: Coord<f64>) -> bool {
    let [abc, abd, cda, cdb] = [orient2d(a, b, c), orient2d(a, b, d), orient2d(c, d, a), orient2d(c, d, b)].map(sign);
    if abc * abd < 0.0 && cda * cdb < 0.0 {
        return true;
    }
    let within = |a: Coord<f64>, b: Coord<f64>, p: Coord<f64>| {
        a.x.min(b.x) <= p.x && p.x <= a.x.max(b.x) && a.y.min(b.y) <= p.y && p.y <= a.y.max(b.y)
    };
    abc == 0.0 && within(a, b, c)
        || abd == 0.0 && within(a, b, d)
        || cda == 0.0 && within(c, d, a)
        || cdb == 0.0 && within(c, d, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(corners: [[f64; 3]; 3]) -> [Point; 3] {
        corners.map(|[x, y, z]| Point::new(x, y, z))
    }

    const FLAT: [[f64; 3]; 3] = [[0., 0., 0.], [4., 0., 0.], [0., 4., 0.]];

    #[test]
    fn crossing_touching_and_apart() {
        let base = triangle(FLAT);
        for (other, meets) in [
            ([[1., 1., -1.], [1., 1., 1.], [2., 2., 1.]], true),      // pierces
            ([[1., 1., 0.], [1., 1., 1.], [2., 2., 1.]], true),       // a corner on it
            ([[1., 1., 1e-300], [1., 1., 1.], [2., 2., 1.]], false),  // just above it
            ([[9., 9., -1.], [9., 9., 1.], [8., 9., 1.]], false),     // beside it
            ([[-1., -1., 0.], [9., 9., 0.], [9., 9., 1.]], true),     // a side in its plane across it
            ([[1., 1., 0.], [2., 1., 0.], [1., 2., 0.]], true),       // inside it, in its plane
            ([[-9., -9., 0.], [20., -9., 0.], [-9., 20., 0.]], true), // around it, in its plane
            ([[3., 3., 0.], [4., 3., 0.], [3., 4., 0.]], false),      // in its plane, beside it
            ([[0., 0., 1.], [4., 0., 1.], [0., 4., 1.]], false),      // parallel
            ([[1., 1., 0.], [1., 1., 0.], [1., 1., 0.]], true),       // a point in it
            ([[5., 5., 0.], [5., 5., 0.], [5., 5., 0.]], false),      // a point beside it
        ] {
            let other = triangle(other);
            for k in 0..3 {
                let turned = [other[k], other[(k + 1) % 3], other[(k + 2) % 3]];
                let flipped = [turned[2], turned[1], turned[0]];
                assert_eq!(triangles_meet(&base, &turned), meets, "{turned:?}");
                assert_eq!(triangles_meet(&flipped, &base), meets, "{flipped:?}");
            }
        }
    }
}
