//! Solids whose values are signed distances (mm) near their surface, and smooth ways to combine them.

use super::dual::Real;

/// Smooth `|x|`, rounded within about a millimetre of the midline.
/// Paired solids are written for the left side only.
pub(super) fn mirrored<T: Real>(p: [T; 3]) -> [T; 3] {
    [(p[0].squared() + 0.25).sqrt(), p[1], p[2]]
}

/// Ellipsoid. The zero set is exact to 5e-7 of its radius; the value is a distance to first order.
pub(super) fn ellipsoid<T: Real>(p: [T; 3], center: [f64; 3], radii: [f64; 3]) -> T {
    let mut k0 = T::constant(1e-6);
    let mut k1 = T::constant(0.0);
    for a in 0..3 {
        let q = (p[a] - center[a]) * (1.0 / radii[a]);
        k0 = k0 + q.squared();
        k1 = k1 + (q * (1.0 / radii[a])).squared();
    }
    // k0 / |∇k0| converts the level to mm. The added terms keep it finite at the centre, where it becomes the mean radius.
    let mean = (radii[0] + radii[1] + radii[2]) / 3.0;
    let length = ((k0 + 1e-3) / (k1 + 1e-3 / (mean * mean))).sqrt();
    (k0.sqrt() - 1.0) * length
}

/// Capsule whose radius varies linearly from `radius_a` at `a` to `radius_b` at `b`.
pub(super) fn capsule<T: Real>(p: [T; 3], a: [f64; 3], b: [f64; 3], radius_a: f64, radius_b: f64) -> T {
    let axis = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let length_sq: f64 = axis.iter().map(|c| c * c).sum();
    let along = (p[0] - a[0]) * axis[0] + (p[1] - a[1]) * axis[1] + (p[2] - a[2]) * axis[2];
    let t = (along * (1.0 / length_sq)).clamp(0.0, 1.0);
    let mut d_sq = T::constant(0.0);
    for c in 0..3 {
        d_sq = d_sq + (p[c] - a[c] - t * axis[c]).squared();
    }
    d_sq.sqrt() - radius_a - t * (radius_b - radius_a)
}

/// Box with half extents `half` and edges rounded by `radius`.
pub(super) fn rounded_box<T: Real>(p: [T; 3], center: [f64; 3], half: [f64; 3], radius: f64) -> T {
    let q = [0, 1, 2].map(|a| (p[a] - center[a]).abs() - (half[a] - radius));
    let zero = T::constant(0.0);
    let outside = (q[0].max(zero).squared() + q[1].max(zero).squared() + q[2].max(zero).squared()).sqrt();
    outside + q[0].max(q[1]).max(q[2]).min(zero) - radius
}

/// Dental arch seen from above: half an ellipse with semi-axes `half_width` along x and `depth` towards the front, centred at
/// (0, `back_y`). Behind the centre its legs run straight back.
#[derive(Clone, Copy)]
pub(super) struct Arch {
    pub(super) half_width: f64,
    pub(super) depth: f64,
    pub(super) back_y: f64,
}

impl Arch {
    /// Distance from the arch in the horizontal plane, negative inside.
    pub(super) fn distance<T: Real>(&self, p: [T; 3]) -> T {
        let front = (p[1] - self.back_y).min(T::constant(0.0));
        let (a, b) = (self.half_width, self.depth);
        let (qx, qy) = (p[0] * (1.0 / a), front * (1.0 / b));
        let k0 = qx.squared() + qy.squared() + 1e-6;
        let k1 = (qx * (1.0 / a)).squared() + (qy * (1.0 / b)).squared();
        let length = ((k0 + 1e-3) / (k1 + 1e-3 / (a * b))).sqrt();
        (k0.sqrt() - 1.0) * length
    }

    /// Wall along the arch of thickness `2 half_thickness` between the heights `low` and `high`, which ends at `end_y` behind.
    /// All edges are rounded by `radius`.
    pub(super) fn wall<T: Real>(
        &self,
        p: [T; 3],
        half_thickness: f64,
        [low, high]: [f64; 2],
        end_y: f64,
        radius: f64,
    ) -> T {
        let zero = T::constant(0.0);
        let q = [
            self.distance(p).abs() - (half_thickness - radius),
            (p[2] - 0.5 * (low + high)).abs() - (0.5 * (high - low) - radius),
            p[1] - (end_y - radius),
        ];
        let outside = (q[0].max(zero).squared() + q[1].max(zero).squared() + q[2].max(zero).squared()).sqrt();
        outside + q[0].max(q[1]).max(q[2]).min(zero) - radius
    }

    /// Wave along the arch: 1 between two teeth, -1 in the middle of each, with `teeth` teeth over the half ellipse.
    pub(super) fn teeth_wave<T: Real>(&self, p: [T; 3], teeth: f64) -> T {
        let sideways = p[0] * (1.0 / self.half_width);
        let forward = (p[1] - self.back_y) * (-1.0 / self.depth);
        (sideways.atan2(forward) * (2.0 * teeth)).cos()
    }
}

/// Union with a fillet about `k` mm wide; equal to the minimum where the values differ by more than `k`.
pub(super) fn union<T: Real>(a: T, b: T, k: f64) -> T {
    let (low, high) = if a.value() <= b.value() { (a, b) } else { (b, a) };
    let h = ((low - high) * (1.0 / k) + 1.0).max(T::constant(0.0));
    low - h.squared() * (0.25 * k)
}

/// Intersection with a fillet about `k` mm wide.
pub(super) fn intersection<T: Real>(a: T, b: T, k: f64) -> T {
    -union(-a, -b, k)
}

/// `a` without `b`, with a fillet about `k` mm wide.
pub(super) fn difference<T: Real>(a: T, b: T, k: f64) -> T {
    -union(-a, b, k)
}
