//! Signed distances from segments, and the cut faces between segments.

use rayon::prelude::*;

use super::Osteotomy;
use super::moved_solid::{MovedSolid, Solid, nearest_bone};
use super::tuning::{FAR_FACE_MM, MIN_FACING, TOUCH_SHARE};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// Cut faces of every segment.
pub(super) struct CutFaces(Vec<(u32, Faces)>);

/// Gap between the cut faces of a segment and other bone.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Gap {
    /// Mean distance from the cut faces to the nearest bone, mm.
    pub(super) mean_mm: f64,
    /// Volume between the cut faces and those opposite, mm³.
    pub(super) volume_mm3: f64,
}

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
    /// Finds the triangles that face a segment at rest from which they were sawn, in contact or across the kerf.
    ///
    /// Teeth that touched in the image and were only separated are no cut faces.
    pub(super) fn of(osteotomy: &Osteotomy, solids: &[(u32, Solid)], control: &Control) -> Result<Self, Cancelled> {
        let segments = &osteotomy.segments;
        let kerf_mm = osteotomy.cuts.iter().map(|c| c.kerf_mm).fold(0.0, f64::max);
        let mut all = Vec::with_capacity(segments.len());
        for segment in segments {
            control.check()?;
            let mesh = &segment.surface;
            let edge = (segment.area_mm2 / mesh.triangles().len() as f64 * 4.0 / 3.0f64.sqrt()).sqrt();
            let far = kerf_mm + TOUCH_SHARE * edge;
            let is_sawn = |id: u32| {
                segments.iter().any(|s| s.id == id && id != segment.id && osteotomy.is_sawn_between(segment, s))
            };
            let others: Vec<&Solid> = solids.iter().filter(|(id, _)| is_sawn(*id)).map(|(_, solid)| solid).collect();
            let face = |t: usize| {
                let [a, b, c] = mesh.corners(t);
                let scaled = mesh.scaled_normal(t);
                let (middle, normal) =
                    (Point::from((a.coords + b.coords + c.coords) / 3.0), scaled.try_normalize(0.0)?);
                let facing = |s: &Solid| s.ahead(&middle, &normal, far).is_some_and(|hit| hit.facing > MIN_FACING);
                Some(Face { middle, normal, area: 0.5 * scaled.norm(), faces: others.iter().any(|s| facing(s)) })
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

    /// Mean distance from the segment's cut faces to the nearest of `others`, mm, and the volume between them and the cut
    /// faces opposite, mm³.
    pub(super) fn gap(&self, id: u32, others: &[MovedSolid<'_>]) -> Gap {
        let Some(faces) = self.of_segment(id) else { return Gap::default() };
        let gap = |Face { middle, normal, area, faces }: &Face| {
            let ahead = |other: &MovedSolid<'_>| {
                let motion = &other.own_from_moving;
                let hit = other.solid.ahead(&(motion * middle), &(motion * normal), FAR_FACE_MM)?;
                let is_cut = self.of_segment(other.segment)?.is_cut.get(hit.triangle) == Some(&true);
                Some((hit.distance_mm, is_cut))
            };
            let first = others.iter().filter_map(ahead).min_by(|a, b| a.0.total_cmp(&b.0));
            let depth = first.map_or(0.0, |(distance, is_cut)| if is_cut { distance } else { 0.0 });
            let facing = if *faces { *area } else { 0.0 };
            [facing, facing * nearest_bone(middle, others).max(0.0), area * depth]
        };
        // Summed in order, so that the result is the same on any number of threads.
        let found: Vec<[f64; 3]> = faces.own.par_iter().with_min_len(256).map(gap).collect();
        let sum = |k: usize| found.iter().map(|f| f[k]).sum::<f64>();
        Gap { mean_mm: if sum(0) > 0.0 { sum(1) / sum(0) } else { 0.0 }, volume_mm3: sum(2) }
    }
}
