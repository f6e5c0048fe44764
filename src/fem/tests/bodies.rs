//! Rigid bodies in closed form.

use crate::geometry::{Implicit, Point, Vector};

/// The half-space below z = 0.
pub(super) struct Floor;

impl Implicit for Floor {
    fn value(&self, p: &Point) -> f64 {
        p.z
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        (p.z, Vector::z())
    }
}

/// A ball.
pub(super) struct Ball {
    pub(super) centre: Point,
    pub(super) radius: f64,
}

impl Implicit for Ball {
    fn value(&self, p: &Point) -> f64 {
        (p - self.centre).norm() - self.radius
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let d = p - self.centre;
        (d.norm() - self.radius, d.try_normalize(1e-12).unwrap_or(Vector::z()))
    }
}
