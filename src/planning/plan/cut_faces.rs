//! Signed distances from segments, and the cut faces between segments.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};
use rayon::prelude::*;

use super::Segment;
use super::follow::{Frame, nearest_bone};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// Farthest distance at which a cut face counts as the opposite side of a gap, mm.
const FAR_MM: f64 = 30.0;
/// At rest a cut face is no farther from its counterpart than the kerf plus this share of the mean edge length.
const TOUCH_SHARE: f64 = 0.1;
/// Least cosine between the normal of a cut face and the reversed normal of its counterpart.
const FACING: f64 = 0.7;

/// A closed surface with signed distances: sign by the pseudonormal of the closest feature.
pub(super) struct Solid(Shape);

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
    ///
    /// Returns the distance (mm), the triangle, and the cosine between `n` and the triangle's reversed normal.
    fn ahead(&self, p: &Point, n: &Vector, far_mm: f64) -> Option<(f64, usize, f64)> {
        // The ray starts a little behind `p`, so that it also meets a face in contact.
        const BEHIND_MM: f64 = 0.2;
        let from = p - n * BEHIND_MM;
        let ray = Ray::new(ParryVector::new(from.x, from.y, from.z), ParryVector::new(n.x, n.y, n.z));
        let hit = self.0.cast_local_ray_and_get_normal(&ray, far_mm + BEHIND_MM, false)?;
        let facing = -hit.normal.dot(ray.dir);
        (facing > 0.0).then_some(((hit.time_of_impact - BEHIND_MM).max(0.0), hit.subshape as usize, facing))
    }
}

/// Cut faces of every segment.
pub(super) struct CutFaces(Vec<(u32, Faces)>);

struct Faces {
    own: Vec<Face>,
    /// For each triangle of the segment, whether it shares a vertex with a triangle that faces other bone.
    is_cut: Vec<bool>,
}

struct Face {
    middle: Point,
    /// Outward unit normal.
    normal: Vector,
    area: f64,
    /// Whether it faces other bone at rest; a face at the rim may only share two vertices with faces that do.
    faces: bool,
}

impl CutFaces {
    /// Finds the triangles that face another segment at rest, in contact or across a kerf of up to `kerf_mm`.
    pub(super) fn of(
        segments: &[Segment],
        solids: &[(u32, Solid)],
        kerf_mm: f64,
        control: &Control,
    ) -> Result<Self, Cancelled> {
        let mut all = Vec::with_capacity(segments.len());
        for segment in segments {
            control.check()?;
            let mesh = &segment.surface;
            let edge = (segment.area_mm2 / mesh.triangles().len() as f64 * 4.0 / 3.0f64.sqrt()).sqrt();
            let far = kerf_mm + TOUCH_SHARE * edge;
            let others = || solids.iter().filter(|(id, _)| *id != segment.id);
            let face = |t: usize| {
                let [a, b, c] = mesh.corners(t);
                let scaled = mesh.scaled_normal(t);
                let (middle, normal) =
                    (Point::from((a.coords + b.coords + c.coords) / 3.0), scaled.try_normalize(0.0)?);
                let facing = |s: &Solid| s.ahead(&middle, &normal, far).is_some_and(|hit| hit.2 > FACING);
                Some(Face { middle, normal, area: 0.5 * scaled.norm(), faces: others().any(|(_, s)| facing(s)) })
            };
            let triangles = mesh.triangles();
            let found: Vec<_> = (0..triangles.len()).into_par_iter().with_min_len(256).map(face).collect();
            let mut at_cut = vec![false; mesh.positions().len()];
            for (triangle, _) in triangles.iter().zip(&found).filter(|(_, f)| f.as_ref().is_some_and(|f| f.faces)) {
                triangle.iter().for_each(|v| at_cut[*v as usize] = true);
            }
            let corners = |t: &[u32; 3]| t.iter().filter(|v| at_cut[**v as usize]).count();
            let own =
                triangles.iter().zip(found).filter(|(t, _)| corners(t) >= 2).filter_map(|(_, face)| face).collect();
            all.push((segment.id, Faces { own, is_cut: triangles.iter().map(|t| corners(t) > 0).collect() }));
        }
        Ok(Self(all))
    }

    fn of_segment(&self, id: u32) -> Option<&Faces> {
        self.0.iter().find(|f| f.0 == id).map(|f| &f.1)
    }

    /// Mean distance from the segment's cut faces to the nearest bone of `frames`, mm, and the volume between them and the cut
    /// faces opposite, mm³.
    pub(super) fn gap(&self, id: u32, frames: &[Frame<'_>]) -> (f64, f64) {
        let Some(faces) = self.of_segment(id) else { return (0.0, 0.0) };
        let gap = |Face { middle, normal, area, faces }: &Face| {
            let ahead = |(other, solid, motion): &Frame<'_>| {
                let (distance, triangle, _) = solid.ahead(&(motion * middle), &(motion * normal), FAR_MM)?;
                let is_cut = self.of_segment(*other)?.is_cut.get(triangle) == Some(&true);
                Some((distance, is_cut))
            };
            let first = frames.iter().filter_map(ahead).min_by(|a, b| a.0.total_cmp(&b.0));
            let depth = first.map_or(0.0, |(distance, is_cut)| if is_cut { distance } else { 0.0 });
            let facing = if *faces { *area } else { 0.0 };
            [facing, facing * nearest_bone(middle, frames).max(0.0), area * depth]
        };
        // Summed in order, so that the result is the same on any number of threads.
        let found: Vec<[f64; 3]> = faces.own.par_iter().with_min_len(256).map(gap).collect();
        let sum = |k: usize| found.iter().map(|f| f[k]).sum::<f64>();
        (if sum(0) > 0.0 { sum(1) / sum(0) } else { 0.0 }, sum(2))
    }
}
