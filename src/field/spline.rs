//! Quadratic B-splines on a lattice: weights of the three nearest coefficients along each axis, and tensor products.

use super::lanes::Lanes;
use nalgebra::Matrix3;
use prosopon_geometry::Vector;

/// Weights of the coefficients at -1, 0 and 1 for a point at `t`, in spacings from the middle one.
pub(super) fn weights(t: f64) -> [f64; 3] {
    let (low, high) = (0.5 - t, 0.5 + t);
    [0.5 * low * low, 0.75 - t * t, 0.5 * high * high]
}

/// Value, gradient and Hessian of a function at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Jet {
    pub(super) value: f64,
    pub(super) gradient: Vector,
    pub(super) hessian: Matrix3<f64>,
}

impl Jet {
    /// The jet of coefficients that are worth `step` (mm) each, on a lattice with `per_mm` nodes per mm.
    #[inline(always)]
    pub(super) fn scaled(mut self, step: f64, per_mm: f64) -> Self {
        self.value *= step;
        self.gradient *= step * per_mm;
        self.hessian *= step * per_mm * per_mm;
        self
    }

    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.value += other.value;
        self.gradient += other.gradient;
        self.hessian += other.hessian;
    }
}

/// Position of a point between three coefficients along an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Between {
    /// Distances from the ends of the middle coefficient's cell, in spacings.
    low: f64,
    high: f64,
    /// Half the squares of these distances.
    low_sq: f64,
    high_sq: f64,
}

impl Between {
    /// Position at `t`, in spacings from the middle coefficient, within [-1/2, 1/2].
    #[inline(always)]
    pub(super) fn at(t: f64) -> Self {
        let (low, high) = (0.5 - t, 0.5 + t);
        Self { low, high, low_sq: 0.5 * low * low, high_sq: 0.5 * high * high }
    }

    /// Weighted sum of three coefficients, and its first and second derivatives with respect to `t`.
    #[inline(always)]
    fn along<L: Lanes>(&self, lanes: L, [a, b, c]: [L::Four; 3]) -> [L::Four; 3] {
        let (from, to) = (lanes.sub(b, a), lanes.sub(c, b));
        let (low, high) = (lanes.mul(lanes.splat(self.low_sq), from), lanes.mul(lanes.splat(self.high_sq), to));
        let value = lanes.add(b, lanes.sub(high, low));
        let (low, high) = (lanes.mul(lanes.splat(self.low), from), lanes.mul(lanes.splat(self.high), to));
        [value, lanes.add(low, high), lanes.sub(to, from)]
    }
}

/// Rows of codes as vectors.
#[inline(always)]
pub(super) fn rows<L: Lanes>(lanes: L, words: &[u64; 9]) -> [L::Four; 9] {
    let mut rows = [lanes.splat(0.0); 9];
    for (row, word) in rows.iter_mut().zip(words) {
        *row = lanes.codes(*word);
    }
    rows
}

/// Value and derivatives (lattice coordinates) of the spline with 3³ coefficients around a node.
///
/// Row j + 3 k has the three coefficients along x; its fourth lane is padding.
#[inline(always)]
pub(super) fn jet<L: Lanes>(lanes: L, rows: &[L::Four; 9], [x, y, z]: &[Between; 3]) -> Jet {
    let near = z.along(lanes, [rows[0], rows[3], rows[6]]);
    let middle = z.along(lanes, [rows[1], rows[4], rows[7]]);
    let far = z.along(lanes, [rows[2], rows[5], rows[8]]);
    let [plain, by_y, by_yy] = y.along(lanes, [near[0], middle[0], far[0]]);
    let [by_z, by_yz, _] = y.along(lanes, [near[1], middle[1], far[1]]);
    let [by_zz, ..] = y.along(lanes, [near[2], middle[2], far[2]]);
    let [values, slopes, bends] = x.along(lanes, lanes.columns([plain, by_y, by_z, by_yz]));
    let ([value, dy, dz, dyz], [dx, dxy, dxz, _]) = (lanes.array(values), lanes.array(slopes));
    let [dxx, ..] = lanes.array(bends);
    let weights = lanes.from([x.low_sq, 1.0 - x.low_sq - x.high_sq, x.high_sq, 0.0]);
    let [a, b, c, _] = lanes.array(lanes.mul(by_yy, weights));
    let dyy = a + b + c;
    let [a, b, c, _] = lanes.array(lanes.mul(by_zz, weights));
    let dzz = a + b + c;
    Jet { value, gradient: Vector::new(dx, dy, dz), hessian: Matrix3::new(dxx, dxy, dxz, dxy, dyy, dyz, dxz, dyz, dzz) }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Plain;
    use super::*;

    #[test]
    fn coefficients_less_an_eighth_of_second_differences_reproduce_a_quadratic() {
        let f = |x: f64, y: f64, z: f64| 1.0 + x - 2.0 * y + 0.3 * z + x * x - y * z + 0.5 * z * z + 0.7 * x * y;
        let mut c = [0.0; 27];
        for (n, c) in c.iter_mut().enumerate() {
            let (x, y, z) = ((n % 3) as f64 - 1.0, (n / 3 % 3) as f64 - 1.0, (n / 9) as f64 - 1.0);
            let second = f(x + 1.0, y, z)
                + f(x - 1.0, y, z)
                + f(x, y + 1.0, z)
                + f(x, y - 1.0, z)
                + f(x, y, z + 1.0)
                + f(x, y, z - 1.0)
                - 6.0 * f(x, y, z);
            *c = f(x, y, z) - second / 8.0;
        }
        let (x, y, z) = (0.3, -0.45, 0.12);
        let rows: [[f64; 4]; 9] = std::array::from_fn(|n| [c[3 * n], c[3 * n + 1], c[3 * n + 2], f64::NAN]);
        let jet = jet(Plain, &rows, &[x, y, z].map(Between::at));
        assert!((jet.value - f(x, y, z)).abs() < 1e-14);
        let gradient = Vector::new(1.0 + 2.0 * x + 0.7 * y, -2.0 - z + 0.7 * x, 0.3 - y + z);
        assert!((jet.gradient - gradient).norm() < 1e-14);
        let hessian = Matrix3::new(2.0, 0.7, 0.0, 0.7, 0.0, -1.0, 0.0, -1.0, 1.0);
        assert!((jet.hessian - hessian).norm() < 1e-13);
    }
}
