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

fn dot(c: &[f64], w: &[f64; 3]) -> f64 {
    c[0] * w[0] + c[1] * w[1] + c[2] * w[2]
}

/// Value of the spline with the 27 coefficients `c` (x fastest).
pub(super) fn value(c: &[f64; 27], [x, y, z]: &[Weights; 3]) -> f64 {
    let plane = |k: usize| {
        let rows = [0, 1, 2].map(|j| dot(&c[9 * k + 3 * j..][..3], &x.value));
        dot(&rows, &y.value)
    };
    dot(&[0, 1, 2].map(plane), &z.value)
}

/// Value and gradient (by lattice coordinates) of the spline with the 27 coefficients `c` (x fastest).
pub(super) fn value_gradient(c: &[f64; 27], [x, y, z]: &[Weights; 3]) -> (f64, Vector) {
    let mut planes = [[0.0; 3]; 3];
    for k in 0..3 {
        let mut rows = [[0.0; 3]; 2];
        for j in 0..3 {
            let row = &c[9 * k + 3 * j..][..3];
            rows[0][j] = dot(row, &x.value);
            rows[1][j] = dot(row, &x.slope);
        }
        planes[0][k] = dot(&rows[0], &y.value);
        planes[1][k] = dot(&rows[1], &y.value);
        planes[2][k] = dot(&rows[0], &y.slope);
    }
    let gradient = Vector::new(dot(&planes[1], &z.value), dot(&planes[2], &z.value), dot(&planes[0], &z.slope));
    (dot(&planes[0], &z.value), gradient)
}

/// Value, gradient and Hessian (by lattice coordinates) of the spline with the 27 coefficients `c` (x fastest).
pub(super) fn jet(c: &[f64; 27], [x, y, z]: &[Weights; 3]) -> Jet {
    // Planes by derivative in (x, y): none, x, y, xx, xy, yy.
    let mut planes = [[0.0; 3]; 6];
    for k in 0..3 {
        let mut rows = [[0.0; 3]; 3];
        for j in 0..3 {
            let row = &c[9 * k + 3 * j..][..3];
            rows[0][j] = dot(row, &x.value);
            rows[1][j] = dot(row, &x.slope);
            rows[2][j] = dot(row, &CURVATURE);
        }
        planes[0][k] = dot(&rows[0], &y.value);
        planes[1][k] = dot(&rows[1], &y.value);
        planes[2][k] = dot(&rows[0], &y.slope);
        planes[3][k] = dot(&rows[2], &y.value);
        planes[4][k] = dot(&rows[1], &y.slope);
        planes[5][k] = dot(&rows[0], &CURVATURE);
    }
    let (xy, xz, yz) = (dot(&planes[4], &z.value), dot(&planes[1], &z.slope), dot(&planes[2], &z.slope));
    let (xx, yy, zz) = (dot(&planes[3], &z.value), dot(&planes[5], &z.value), dot(&planes[0], &CURVATURE));
    Jet {
        value: dot(&planes[0], &z.value),
        gradient: Vector::new(dot(&planes[1], &z.value), dot(&planes[2], &z.value), dot(&planes[0], &z.slope)),
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
