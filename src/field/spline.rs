//! Quadratic B-splines on a lattice: weights of the three nearest coefficients along each axis, and their products.

use crate::geometry::Vector;
use nalgebra::Matrix3;

/// Weights of the coefficients at -1, 0, 1 for a point at `t` (in [-1/2, 1/2], in spacings from the nearest), with their
/// first and second derivatives by `t`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    pub(super) value: [f64; 3],
    pub(super) slope: [f64; 3],
}

/// Second derivatives of the weights; they do not depend on the place.
const CURVATURE: [f64; 3] = [1.0, -2.0, 1.0];

impl Weights {
    #[inline(always)]
    pub(super) fn at(t: f64) -> Self {
        let (low, high) = (0.5 - t, 0.5 + t);
        Self { value: [0.5 * low * low, 0.75 - t * t, 0.5 * high * high], slope: [-low, -2.0 * t, high] }
    }
}

/// Value, gradient and Hessian.
#[derive(Debug, Clone, Copy)]
pub(super) struct Jet {
    pub(super) value: f64,
    pub(super) gradient: Vector,
    pub(super) hessian: Matrix3<f64>,
}

/// The 3³ coefficients around a node as rows along x, y fastest; the fourth lane does not count.
pub(super) type Rows = [[f64; 4]; 9];

/// Rows of coefficients, x fastest.
pub(super) fn rows(c: &[f64; 27]) -> Rows {
    let mut rows = [[0.0; 4]; 9];
    for (row, c) in rows.iter_mut().zip(c.chunks_exact(3)) {
        *row = [c[0], c[1], c[2], 0.0];
    }
    rows
}

#[inline(always)]
fn sum(a: &[f64; 4], b: &[f64; 4], c: &[f64; 4], w: &[f64; 3]) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for l in 0..4 {
        sum[l] = a[l] * w[0] + b[l] * w[1] + c[l] * w[2];
    }
    sum
}

#[inline(always)]
fn across_z(r: &Rows, w: &[f64; 3]) -> [[f64; 4]; 3] {
    [sum(&r[0], &r[3], &r[6], w), sum(&r[1], &r[4], &r[7], w), sum(&r[2], &r[5], &r[8], w)]
}

#[inline(always)]
fn across_y([a, b, c]: &[[f64; 4]; 3], w: &[f64; 3]) -> [f64; 4] {
    sum(a, b, c, w)
}

#[inline(always)]
fn dot(c: &[f64; 4], w: &[f64; 3]) -> f64 {
    c[0] * w[0] + c[1] * w[1] + c[2] * w[2]
}

/// Value of the spline with the coefficients `r`.
#[inline(always)]
pub(super) fn value(r: &Rows, [x, y, z]: &[Weights; 3]) -> f64 {
    dot(&across_y(&across_z(r, &z.value), &y.value), &x.value)
}

/// Value and gradient (by lattice coordinates) of the spline with the coefficients `r`.
#[inline(always)]
pub(super) fn value_gradient(r: &Rows, [x, y, z]: &[Weights; 3]) -> (f64, Vector) {
    let plane = across_z(r, &z.value);
    let plain = across_y(&plane, &y.value);
    let along_y = across_y(&plane, &y.slope);
    let along_z = across_y(&across_z(r, &z.slope), &y.value);
    let gradient = Vector::new(dot(&plain, &x.slope), dot(&along_y, &x.value), dot(&along_z, &x.value));
    (dot(&plain, &x.value), gradient)
}

/// Value, gradient and Hessian (by lattice coordinates) of the spline with the coefficients `r`.
#[inline(always)]
pub(super) fn jet(r: &Rows, [x, y, z]: &[Weights; 3]) -> Jet {
    let (plane, slope, bend) = (across_z(r, &z.value), across_z(r, &z.slope), across_z(r, &CURVATURE));
    let plain = across_y(&plane, &y.value);
    let along_y = across_y(&plane, &y.slope);
    let along_z = across_y(&slope, &y.value);
    let (xy, xz) = (dot(&along_y, &x.slope), dot(&along_z, &x.slope));
    let yz = dot(&across_y(&slope, &y.slope), &x.value);
    let xx = dot(&plain, &CURVATURE);
    let yy = dot(&across_y(&plane, &CURVATURE), &x.value);
    let zz = dot(&across_y(&bend, &y.value), &x.value);
    Jet {
        value: dot(&plain, &x.value),
        gradient: Vector::new(dot(&plain, &x.slope), dot(&along_y, &x.value), dot(&along_z, &x.value)),
        hessian: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
    }
}

#[cfg(test)]
mod tests {
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
        let c = rows(&c);
        let jet = jet(&c, &[Weights::at(x), Weights::at(y), Weights::at(z)]);
        assert!((jet.value - f(x, y, z)).abs() < 1e-14);
        let gradient = Vector::new(1.0 + 2.0 * x + 0.7 * y, -2.0 - z + 0.7 * x, 0.3 - y + z);
        assert!((jet.gradient - gradient).norm() < 1e-14);
        let hessian = Matrix3::new(2.0, 0.7, 0.0, 0.7, 0.0, -1.0, 0.0, -1.0, 1.0);
        assert!((jet.hessian - hessian).norm() < 1e-13);
        let (value, gradient) = value_gradient(&c, &[Weights::at(x), Weights::at(y), Weights::at(z)]);
        assert!((value - jet.value).abs() < 1e-14 && (gradient - jet.gradient).norm() < 1e-14);
    }
}
