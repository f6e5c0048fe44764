//! Splits faces with more than three corners into triangles.

use prosopon_geometry::{Point, Vector};

/// Most corners of a face; scanned and modelled surfaces have fewer. The limit bounds the work on a crafted file.
pub(super) const MAX_CORNERS: usize = 1000;

/// Splits a polygon into a fan of triangles around one of its corners.
///
/// The fan's centre is the first corner for which no triangle faces against the polygon; any corner of a convex polygon
/// qualifies. `None` when an index is out of range or no corner qualifies. Polygons of more than 32 corners are tried at
/// their first corner only.
#[expect(clippy::arithmetic_side_effects, clippy::indexing_slicing, reason = "indices are modulo the length")]
pub(super) fn fan(positions: &[Point], polygon: &[u32]) -> Option<Vec<[u32; 3]>> {
    let n = polygon.len();
    let points: Vec<Point> = polygon.iter().map(|&v| positions.get(v as usize).copied()).collect::<Option<_>>()?;
    if n < 3 {
        return None;
    }
    // Twice the vector area (Newell): its direction is the polygon's normal even with reflex corners.
    let side: Vector = (1..n - 1).map(|i| (points[i] - points[0]).cross(&(points[i + 1] - points[0]))).sum();
    let tries = if n <= 32 { n } else { 1 };
    (0..tries).find_map(|start| {
        let at = |i: usize| (start + i) % n;
        let agrees = (1..n - 1).all(|i| {
            let [a, b, c] = [points[start], points[at(i)], points[at(i + 1)]];
            // The tolerance accepts triangles without area (corners on a line), whose sign is decided by rounding.
            (b - a).cross(&(c - a)).dot(&side) >= -1e-9 * side.norm_squared()
        });
        agrees.then(|| (1..n - 1).map(|i| [polygon[start], polygon[at(i)], polygon[at(i + 1)]]).collect())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(p: &[Point], triangles: &[[u32; 3]]) -> f64 {
        let corner = |v: u32| p[v as usize];
        triangles.iter().map(|t| 0.5 * (corner(t[1]) - corner(t[0])).cross(&(corner(t[2]) - corner(t[0]))).z).sum()
    }

    #[test]
    fn a_fan_keeps_the_area_and_every_triangle_faces_one_way() {
        let p: Vec<Point> =
            [(0., 0.), (4., 0.), (4., 4.), (2., 1.)].iter().map(|&(x, y)| Point::new(x, y, 0.)).collect();
        // An arrowhead with its reflex corner last: only fans around corners 1 and 3 work.
        let fan = fan(&p, &[0, 1, 2, 3]).unwrap();
        assert_eq!(fan, [[1, 2, 3], [1, 3, 0]]);
        assert!((area(&p, &fan) - 6.0).abs() < 1e-12);
        assert!(fan.iter().all(|t| area(&p, &[*t]) > 0.0));
    }

    #[test]
    fn what_has_no_fan_is_refused() {
        let star: Vec<Point> = (0..10)
            .map(|i| {
                let (r, a) = (if i % 2 == 0 { 5.0 } else { 1.0 }, f64::from(i) * std::f64::consts::PI / 5.0);
                Point::new(r * a.cos(), r * a.sin(), 0.0)
            })
            .collect();
        assert_eq!(fan(&star, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]), None);
        assert_eq!(fan(&star, &[0, 1, 2, 10]), None);
        assert_eq!(fan(&star, &[0, 1]), None);
    }
}
