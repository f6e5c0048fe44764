//! Closest point of a triangle.

use prosopon_geometry::Vector;

/// The part of a triangle in which its closest point lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Feature {
    Face,
    /// From this corner to the next.
    Edge(usize),
    Corner(usize),
}

/// Closest point of a triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Closest {
    pub(super) feature: Feature,
    /// Weights of the corners.
    pub(super) weights: [f64; 3],
    /// From the closest point to the given one.
    pub(super) away: Vector,
}

/// Closest point to `p` of the triangle `a`, `b`, `c` (Ericson, Real-Time Collision Detection, 5.1.5).
pub(super) fn closest(p: &Vector, [a, b, c]: &[Vector; 3]) -> Closest {
    let (ab, ac) = (b - a, c - a);
    let found = |feature, weights: [f64; 3]| {
        let at = a * weights[0] + b * weights[1] + c * weights[2];
        Closest { feature, weights, away: p - at }
    };
    let (ap, bp, cp) = (p - a, p - b, p - c);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return found(Feature::Corner(0), [1.0, 0.0, 0.0]);
    }
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return found(Feature::Corner(1), [0.0, 1.0, 0.0]);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let s = d1 / (d1 - d3);
        return found(Feature::Edge(0), [1.0 - s, s, 0.0]);
    }
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return found(Feature::Corner(2), [0.0, 0.0, 1.0]);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let s = d2 / (d2 - d6);
        return found(Feature::Edge(2), [1.0 - s, 0.0, s]);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let s = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return found(Feature::Edge(1), [0.0, 1.0 - s, s]);
    }
    let whole = va + vb + vc;
    let (v, w) = (vb / whole, vc / whole);
    found(Feature::Face, [1.0 - v - w, v, w])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a dense sampling of the triangle, for points on all sides of it.
    #[test]
    fn no_sample_of_the_triangle_is_closer() {
        let corners = [Vector::new(0.0, 0.0, 0.0), Vector::new(3.0, 0.5, 0.2), Vector::new(0.8, 2.0, -0.4)];
        let mut features = [0; 3];
        for i in 0..400 {
            let at = |k: f64| 2.0 * (f64::from(i) * k).sin();
            let p = Vector::new(1.0 + at(1.3), 1.0 + at(2.9), at(0.7));
            let found = closest(&p, &corners);
            let n = 60;
            let sampled = (0..=n).flat_map(|i| (0..=n - i).map(move |j| (i, j))).map(|(i, j)| {
                let (v, w) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                (p - corners[0] * (1.0 - v - w) - corners[1] * v - corners[2] * w).norm()
            });
            let least = sampled.fold(f64::INFINITY, f64::min);
            assert!(found.away.norm() <= least + 1e-12 && found.away.norm() > least - 0.1, "{found:?} {least}");
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            features[match found.feature {
                Feature::Face => 0,
                Feature::Edge(_) => 1,
                Feature::Corner(_) => 2,
            }] += 1;
        }
        assert!(features.iter().all(|n| *n > 10), "{features:?}");
    }
}
