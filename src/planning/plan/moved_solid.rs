//! Signed distances from segments at rest and moved.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};

use super::Segment;
use prosopon_geometry::{Motion, Point, Vector};

/// A closed surface with signed distances: sign by the pseudonormal of the closest feature.
pub(super) struct Solid(Shape);

/// Where a ray enters a [`Solid`].
pub(super) struct Hit {
    /// Distance from the ray's start, mm.
    pub(super) distance_mm: f64,
    pub(super) triangle: usize,
    /// Cosine between the ray and the triangle's reversed normal.
    pub(super) facing: f64,
}

impl Solid {
    pub(super) fn new(segment: &Segment) -> Option<Self> {
        let vertices = segment.surface.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
        let triangles = segment.surface.triangles().to_vec();
        Shape::with_flags(vertices, triangles, TriMeshFlags::ORIENTED).ok().map(Self)
    }

    pub(super) fn signed(&self, p: &Point) -> f64 {
        self.signed_towards(p).0
    }

    /// Signed distance of `p`, mm, and the outward unit direction there; the direction is zero on the surface itself.
    pub(super) fn signed_towards(&self, p: &Point) -> (f64, Vector) {
        let q = ParryVector::new(p.x, p.y, p.z);
        let projection = self.0.project_local_point(q, false);
        let off = q - projection.point;
        let (distance, off) = (off.length(), Vector::new(off.x, off.y, off.z));
        let sign = if projection.is_inside { -1.0 } else { 1.0 };
        (sign * distance, off.try_normalize(1e-12).map_or_else(Vector::zeros, |u| u * sign))
    }

    /// Where the ray from `p` along the unit vector `n` enters the surface within `far_mm`; `p` lies outside or on the surface.
    pub(super) fn ahead(&self, p: &Point, n: &Vector, far_mm: f64) -> Option<Hit> {
        // The ray starts a little behind `p`, so that it also meets a face in contact.
        const BEHIND_MM: f64 = 0.2;
        let from = p - n * BEHIND_MM;
        let ray = Ray::new(ParryVector::new(from.x, from.y, from.z), ParryVector::new(n.x, n.y, n.z));
        let hit = self.0.cast_local_ray_and_get_normal(&ray, far_mm + BEHIND_MM, false)?;
        let facing = -hit.normal.dot(ray.dir);
        let distance_mm = (hit.time_of_impact - BEHIND_MM).max(0.0);
        (facing > 0.0).then_some(Hit { distance_mm, triangle: hit.subshape as usize, facing })
    }
}

/// Another segment as seen from a moving one.
pub(super) struct MovedSolid<'a> {
    /// Number of the segment.
    pub(super) segment: u32,
    pub(super) solid: &'a Solid,
    /// From the moving segment's rest frame into this one's.
    pub(super) own_from_moving: Motion,
}

impl MovedSolid<'_> {
    /// Signed distance of `p`, in the moving segment's rest frame, mm.
    pub(super) fn signed(&self, p: &Point) -> f64 {
        self.solid.signed(&(self.own_from_moving * p))
    }
}

/// Signed distance from `p`, in the moving segment's rest frame, to the nearest of `others`, mm; infinite without others.
pub(super) fn nearest_bone(p: &Point, others: &[MovedSolid<'_>]) -> f64 {
    others.iter().map(|other| other.signed(p)).fold(f64::INFINITY, f64::min)
}
