//! Analytic head-like solids for the tests of this module.

use super::domain::{Domain, MeshSettings, Region};
use prosopon_geometry::{Aabb, Implicit, Point, Vector};

type Value = Box<dyn Fn(&Point) -> f64 + Sync>;

/// A solid given by its value alone; gradients are central differences.
pub(super) struct Shape(pub(super) Value);

impl Implicit for Shape {
    fn value(&self, p: &Point) -> f64 {
        (self.0)(p)
    }
    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let h = 1e-4;
        let d = |a: usize| (self.value(&(p + Vector::ith(a, h))) - self.value(&(p - Vector::ith(a, h)))) / (2.0 * h);
        (self.value(p), Vector::new(d(0), d(1), d(2)))
    }
}

/// Empty space.
pub(super) struct Nothing;

impl Implicit for Nothing {
    fn value(&self, _: &Point) -> f64 {
        1000.0
    }
    fn value_gradient(&self, _: &Point) -> (f64, Vector) {
        (1000.0, Vector::zeros())
    }
}

/// Ellipsoid whose value near its surface is a distance (Quilez).
pub(super) fn ellipsoid(p: &Point, centre: [f64; 3], radii: [f64; 3]) -> f64 {
    let q = p - Point::from(centre);
    let (r, r2) = (Vector::from(radii), Vector::from(radii.map(|r| r * r)));
    let k0 = q.component_div(&r).norm();
    let k1 = q.component_div(&r2).norm();
    if k1 < 1e-9 { -radii.iter().copied().fold(f64::INFINITY, f64::min) } else { k0 * (k0 - 1.0) / k1 }
}

pub(super) fn smooth_union(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

impl Shape {
    pub(super) fn ball(centre: Point, radius: f64) -> Self {
        Self(Box::new(move |p| (p - centre).norm() - radius))
    }

    /// Skin of a head whose face looks to -y: ellipsoid, nose, and a crease between the lips.
    pub(super) fn head_skin() -> Self {
        Self(Box::new(|p| {
            let head = ellipsoid(p, [0.0; 3], [70.0, 90.0, 110.0]);
            let nose = ellipsoid(p, [0.0, -88.0, 0.0], [13.0, 20.0, 18.0]);
            let lips = ellipsoid(p, [0.0, -78.0, -38.0], [24.0, 14.0, 13.0]);
            let face = smooth_union(smooth_union(head, nose, 8.0), lips, 8.0);
            // A groove of rounded V shape, 3 mm deep.
            let q = Vector::new((p.x.abs() - 18.0).max(0.0), 0.0, p.z + 38.0);
            face + 3.0 * (-(q.z * q.z + q.x * q.x) / 6.0).exp()
        }))
    }

    /// Bone under [`Self::head_skin`]: thin tissue at the forehead, thick at the cheeks, none at one spot.
    pub(super) fn head_bone() -> Self {
        Self(Box::new(|p| {
            let skull = ellipsoid(p, [0.0, 4.0, 10.0], [52.0, 80.0, 96.0]);
            // Down to 0.5 mm below the skin at the forehead, and through the skin at one spot.
            let ridge = ellipsoid(p, [30.0, -52.0, 55.0], [16.0, 14.0, 16.0]);
            let chin = ellipsoid(p, [0.0, -60.0, -70.0], [24.0, 14.0, 14.0]);
            smooth_union(smooth_union(skull, ridge, 4.0), chin, 6.0)
        }))
    }
}

pub(super) fn face_region() -> Region {
    Region {
        bounds: Aabb { min: Point::new(-80.0, -120.0, -80.0), max: Point::new(80.0, -10.0, 80.0) },
        half_spaces: vec![],
    }
}

/// Whether a point lies in the tissue that is to be meshed.
pub(super) fn within(domain: &Domain<'_>, settings: &MeshSettings, p: &Point) -> bool {
    let skin = domain.skin.value(p);
    domain.region.value_gradient(p).0 < 0.0
        && skin < 0.0
        && skin > -settings.depth_mm
        && domain.bone.value(p) > 0.0
        && domain.air.is_none_or(|air| air.value(p) > 0.0)
}
