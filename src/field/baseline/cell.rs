//! Trilinear cells, and the continuation of a field beyond its box.

use prosopon_geometry::{Aabb, Point, Vector};

/// Value of the trilinear interpolant of `corners` (x fastest) and its derivatives along the edges of the unit cell.
pub(super) fn trilinear(corners: &[f64; 8], t: [f64; 3]) -> (f64, Vector) {
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let c = corners;
    let x = [0, 2, 4, 6].map(|i: usize| lerp(c[i], c[i + 1], t[0]));
    let dx = [0, 2, 4, 6].map(|i: usize| c[i + 1] - c[i]);
    let (y0, y1) = (lerp(x[0], x[1], t[1]), lerp(x[2], x[3], t[1]));
    let gradient = Vector::new(
        lerp(lerp(dx[0], dx[1], t[1]), lerp(dx[2], dx[3], t[1]), t[2]),
        lerp(x[1] - x[0], x[3] - x[2], t[2]),
        y1 - y0,
    );
    (lerp(y0, y1, t[2]), gradient)
}

/// Like [`trilinear`], for signed distances that may jump.
///
/// Where the sign changes although all corners are beyond the band, as behind the rim of an open surface, the value jumps
/// instead of passing through zero.
pub(super) fn sampled(corners: &[f64; 8], t: [f64; 3], band: f64) -> (f64, Vector) {
    let (value, gradient) = trilinear(corners, t);
    let is_one_side = corners.iter().all(|c| (*c < 0.0) == (corners[0] < 0.0));
    if is_one_side || corners.iter().any(|c| c.abs() <= band) {
        return (value, gradient);
    }
    let sign = 1f64.copysign(value);
    let (size, slope) = trilinear(&corners.map(f64::abs), t);
    (size * sign, slope * sign)
}

/// The closest point of `domain`; for `p` outside also the unit vector to `p` and the distance, mm.
pub(super) fn clamped(domain: &Aabb, p: &Point) -> (Point, Option<(Vector, f64)>) {
    let inner = p.sup(&domain.min).inf(&domain.max);
    let offset = p - inner;
    // The offset is scaled so that no square overflows.
    let scale = offset.amax();
    if scale == 0.0 {
        return (inner, None);
    }
    let scaled = offset / scale;
    let length = scaled.norm();
    (inner, Some((scaled / length, scale * length)))
}

/// Continues a function on `domain` beyond it, continuous and growing.
///
/// The value is that at the closest point of the box plus the distance from there.
pub(super) fn continued(domain: &Aabb, p: &Point, inside: impl Fn(&Point) -> (f64, Vector)) -> (f64, Vector) {
    let (inner, beyond) = clamped(domain, p);
    let (value, mut gradient) = inside(&inner);
    let Some((direction, distance)) = beyond else { return (value, gradient) };
    // A step along a clamped axis does not move the closest point of the box.
    for a in 0..3 {
        if direction[a] != 0.0 {
            gradient[a] = 0.0;
        }
    }
    (value + distance, gradient + direction)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trilinear_function_and_its_gradient_are_reproduced() {
        let f = |x: f64, y: f64, z: f64| 1.0 + 2.0 * x - y + 3.0 * x * y * z + y * z;
        let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|i: usize| f((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64));
        let (x, y, z) = (0.3, 0.6, 0.2);
        let (value, gradient) = trilinear(&corners, [x, y, z]);
        assert!((value - f(x, y, z)).abs() < 1e-14);
        let expected = Vector::new(2.0 + 3.0 * y * z, -1.0 + 3.0 * x * z + z, 3.0 * x * y + y);
        assert!((gradient - expected).norm() < 1e-14);
    }
}
