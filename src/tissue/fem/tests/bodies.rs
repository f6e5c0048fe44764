//! Rigid bodies in closed form.

use prosopon_geometry::{Implicit, Point, Vector};

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

/// A post about the z axis with rounded edges, unbounded below, whose top is z = 0.
pub(super) struct RoundedPost {
    pub(super) half_width: f64,
    pub(super) edge_radius: f64,
}

impl Implicit for RoundedPost {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let inner = self.half_width - self.edge_radius;
        let q = Vector::new(p.x.abs() - inner, p.y.abs() - inner, p.z + self.edge_radius);
        let sign = Vector::new(p.x.signum(), p.y.signum(), 1.0);
        let deepest = q.imax();
        let (distance, normal) = if q[deepest] < 0.0 {
            (q[deepest], Vector::ith(deepest, 1.0))
        } else {
            let out = q.map(|c| c.max(0.0));
            (out.norm(), out.normalize())
        };
        (distance - self.edge_radius, normal.component_mul(&sign))
    }
}

/// A flat disc about the z axis with a rounded rim, whose top is z = 0.
pub(super) struct Coin {
    /// Radius of the flat part, mm.
    pub(super) radius: f64,
    pub(super) half_thickness: f64,
}

impl Implicit for Coin {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let r = p.x.hypot(p.y);
        let beyond = (r - self.radius).max(0.0) / r.max(1e-12);
        let from_disc = Vector::new(p.x * beyond, p.y * beyond, p.z + self.half_thickness);
        (from_disc.norm() - self.half_thickness, from_disc.try_normalize(1e-12).unwrap_or(Vector::z()))
    }
}
