use crate::Point;

/// Squared distance from `p` to the triangle `a`, `b`, `c`, mm².
///
/// # Source
/// C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
pub(super) fn distance_sq(p: &Point, a: &Point, b: &Point, c: &Point) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.norm_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.norm_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).norm_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.norm_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).norm_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).norm_squared();
    }
    let denominator = va + vb + vc;
    (ap - ab * (vb / denominator) - ac * (vc / denominator)).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_sampling_the_triangle_in_every_region() {
        let [a, b, c] = [Point::new(0.0, 0.0, 0.0), Point::new(4.0, 0.0, 1.0), Point::new(1.0, 3.0, -1.0)];
        for i in 0..343 {
            let p = Point::new(
                f64::from(i % 7) * 2.0 - 4.0,
                f64::from(i / 7 % 7) * 2.0 - 5.0,
                f64::from(i / 49) * 2.0 - 5.5,
            );
            let n = 200;
            let mut sampled = f64::MAX;
            for s in 0..=n {
                for t in 0..=n - s {
                    let q = a + (b - a) * (f64::from(s) / f64::from(n)) + (c - a) * (f64::from(t) / f64::from(n));
                    sampled = sampled.min((p - q).norm());
                }
            }
            let exact = distance_sq(&p, &a, &b, &c).sqrt();
            // The sampled points are at most 4.3 / 200 apart.
            assert!(exact <= sampled + 1e-12 && sampled - exact < 0.022, "{p}: {exact} {sampled}");
        }
    }
}
