use crate::{Point, Vector};
use nalgebra::Matrix3;

/// Weighted sum of squared distances from planes, `xᵀ A x + 2 bᵀ x + c`, with the sum of the weights.
///
/// # Source
/// Garland & Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadric {
    /// Upper triangle of A: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: Vector,
    c: f64,
    weight: f64,
}

impl Quadric {
    pub(super) const ZERO: Self = Self { a: [0.0; 6], b: Vector::new(0.0, 0.0, 0.0), c: 0.0, weight: 0.0 };

    /// Weighted squared distance from the plane through `point` with unit normal `n`.
    pub(super) fn plane(point: &Point, n: &Vector, weight: f64) -> Self {
        let d = -n.dot(&point.coords);
        Self {
            a: [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z].map(|v| weight * v),
            b: n * (weight * d),
            c: weight * d * d,
            weight,
        }
    }

    /// Weighted squared distance from `point`; it keeps vertices of flat regions near their position.
    ///
    /// It adds nothing to the sum of the weights.
    pub(super) fn anchor(point: &Point, weight: f64) -> Self {
        let w = weight;
        Self { a: [w, 0.0, 0.0, w, 0.0, w], b: point.coords * -w, c: w * point.coords.norm_squared(), weight: 0.0 }
    }

    pub(super) fn plus(&self, o: &Self) -> Self {
        Self {
            a: std::array::from_fn(|i| self.a[i] + o.a[i]),
            b: self.b + o.b,
            c: self.c + o.c,
            weight: self.weight + o.weight,
        }
    }

    /// Weighted mean of the squared distances at `x`, mm².
    pub(super) fn mean_square(&self, x: &Point) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let v = x.coords;
        let ax =
            Vector::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z);
        ((v.dot(&ax) + 2.0 * self.b.dot(&v) + self.c) / self.weight.max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Point at which the sum is smallest; `None` when it is not unique.
    pub(super) fn minimum(&self) -> Option<Point> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let x = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).cholesky()?.solve(&-self.b);
        x.iter().all(|c| c.is_finite()).then(|| Point::from(x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_in_their_corner() {
        let corner = Point::new(3.0, -4.0, 120.0);
        let planes = [Vector::x(), Vector::y(), Vector::new(0.0, 0.6, 0.8)];
        let q = planes.iter().map(|n| Quadric::plane(&corner, n, 2.0)).fold(Quadric::ZERO, |a, b| a.plus(&b));
        assert!((q.minimum().unwrap() - corner).norm() < 1e-9);
        assert!(q.mean_square(&corner) < 1e-9);
        // A step of 1 mm along x leaves one of the three planes by 1 mm.
        assert!((q.mean_square(&(corner + Vector::x())) - 1.0 / 3.0).abs() < 1e-9);
    }

    #[test]
    fn one_plane_has_no_unique_minimum_without_an_anchor() {
        let p = Point::new(1.0, 2.0, 3.0);
        let plane = Quadric::plane(&p, &Vector::z(), 1.0);
        assert!(plane.minimum().is_none());
        let anchored = plane.plus(&Quadric::anchor(&p, 1e-3));
        assert!((anchored.minimum().unwrap() - p).norm() < 1e-9);
    }
}
