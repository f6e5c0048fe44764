use prosopon_geometry::{Point, Vector};

/// Closest point of the triangle `a b c` to `p`, by Voronoi region; handles triangles without area.
///
/// # Source
/// C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5.
#[inline]
pub(super) fn closest_point(p: &Point, [a, b, c]: &[Point; 3]) -> Point {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        // With a = b this test does not involve c.
        return if a == b { closest_on_segment(p, a, c) } else { closest_on_segment(p, a, b) };
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return closest_on_segment(p, a, c);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return closest_on_segment(p, b, c);
    }
    let sum = va + vb + vc;
    // Below an angle of 1e-5 barycentric weights are rounding errors; the edges represent such a needle.
    if sum <= 1e-10 * ab.norm_squared() * ac.norm_squared() {
        return closest_on_edges(p, a, b, c);
    }
    a + ab * (vb / sum) + ac * (vc / sum)
}

fn closest_on_segment(p: &Point, a: &Point, b: &Point) -> Point {
    let ab = b - a;
    let length_sq = ab.norm_squared();
    if length_sq == 0.0 {
        return *a;
    }
    a + ab * (ab.dot(&(p - a)) / length_sq).clamp(0.0, 1.0)
}

fn closest_on_edges(p: &Point, a: &Point, b: &Point, c: &Point) -> Point {
    let mut best = closest_on_segment(p, a, b);
    for q in [closest_on_segment(p, b, c), closest_on_segment(p, c, a)] {
        if (q - p).norm_squared() < (best - p).norm_squared() {
            best = q;
        }
    }
    best
}

/// Solid angle of the triangle seen from `p`, steradian; positive from behind (inside a solid).
///
/// # Source
/// A. van Oosterom, J. Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 1983.
pub(super) fn solid_angle(p: &Point, corners: &[Point; 3]) -> f64 {
    let [a, b, c]: [Vector; 3] = corners.map(|q| q - p);
    let det = a.dot(&b.cross(&c));
    // In its own plane a triangle subtends nothing, except on the triangle itself, where any value is right.
    if det == 0.0 {
        return 0.0;
    }
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * det.atan2(denominator)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smallest distance over a dense sampling of the triangle: a tight upper bound.
    fn sampled_distance(p: &Point, [a, b, c]: &[Point; 3]) -> f64 {
        let n = 200;
        let mut best = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=(n - i) {
                let q = a + (b - a) * (i as f64 / n as f64) + (c - a) * (j as f64 / n as f64);
                best = best.min((q - p).norm());
            }
        }
        best
    }

    #[test]
    fn closest_point_agrees_with_dense_sampling_in_every_region_and_for_triangles_without_area() {
        let triangles = [
            [Point::new(0.0, 0.0, 0.0), Point::new(2.0, 0.1, 0.0), Point::new(0.3, 1.5, 0.4)],
            [Point::new(0.0, 0.0, 0.0), Point::new(2.0, 0.0, 0.0), Point::new(1.0, 1e-9, 0.0)],
            [Point::new(0.0, 0.0, 0.0), Point::new(1.0, 1.0, 1.0), Point::new(3.0, 3.0, 3.0)],
            [Point::new(1.0, 0.0, 0.0), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 2.0, 0.0)],
            [Point::new(0.5, 0.5, 0.5); 3],
        ];
        for t in &triangles {
            for i in 0..7 {
                for j in 0..7 {
                    for k in 0..3 {
                        let p = Point::new(i as f64 * 0.6 - 0.9, j as f64 * 0.6 - 0.9, k as f64 * 0.7 - 0.6);
                        let q = closest_point(&p, t);
                        let (found, sampled) = ((q - p).norm(), sampled_distance(&p, t));
                        assert!(found <= sampled + 1e-9 && found > sampled - 0.02, "{found} {sampled} {t:?} {p}");
                    }
                }
            }
        }
    }

    #[test]
    fn an_octant_subtends_an_eighth_of_the_sphere_seen_from_behind() {
        let t = [Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::new(0.0, 0.0, 1.0)];
        assert!((solid_angle(&Point::origin(), &t) - std::f64::consts::FRAC_PI_2).abs() < 1e-14);
        let flipped = [t[0], t[2], t[1]];
        assert!((solid_angle(&Point::origin(), &flipped) + std::f64::consts::FRAC_PI_2).abs() < 1e-14);
    }
}
