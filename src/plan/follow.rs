//! What a segment meets on its path.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};
use rayon::prelude::*;

use super::{Osteotomy, Path, Plan, PlanError, Segment};
use crate::control::{Cancelled, Control};
use crate::geometry::{Motion, Point};

/// Samples along a path, besides its waypoints.
const SAMPLES: usize = 10;
/// At most about this many vertices of a segment are tested against other bone.
const PROBES: usize = 6000;
/// Vertices this near to another segment at rest lie on a cap, in shares of the mean edge length.
const CAP_SHARE: f64 = 0.1;

/// How a segment travels and what it meets.
#[derive(Debug, Clone, PartialEq)]
pub struct PathReport {
    /// The segment.
    pub segment: u32,
    /// Largest displacement of a point of the segment at the end, mm.
    pub max_displacement_mm: f64,
    /// Displacement of its centroid at the end, LPS mm.
    pub centroid_displacement_mm: [f64; 3],
    /// Length of the centroid's path, mm.
    pub path_length_mm: f64,
    /// Per sampled t: deepest overlap with other bone (mm, 0 when none) and mean gap opened at the cut faces (mm).
    pub along: Vec<(f64, f64, f64)>,
}

/// Follows every path, at t = 0, 0.1, … 1 and at its waypoints.
///
/// Overlap and gap are measured at up to 6000 or so vertices of the segment, evenly picked by number, against the surfaces
/// of all other segments where they are at that t. Cut faces are the vertices that touch another segment at rest; the gap
/// is the mean over them of the distance to the nearest other bone, 0 where they overlap: a face that slides along
/// another has no gap.
///
/// # Errors
/// [`PlanError::Value`] when a path names a segment that does not exist, segment 0, or one that has a path already;
/// cancellation.
pub fn follow(osteotomy: &Osteotomy, plan: &Plan, control: &Control) -> Result<Vec<PathReport>, PlanError> {
    let n = osteotomy.segments.len();
    for (i, path) in plan.paths.iter().enumerate() {
        let id = path.segment();
        let fault = |detail: String| Err(PlanError::Value { what: format!("paths[{i}].segment"), detail });
        if id == 0 || !osteotomy.segments.iter().any(|s| s.id == id) {
            return fault(format!("is {id}, allowed are the segments 1 to {}", n.saturating_sub(1)));
        }
        if plan.paths[..i].iter().any(|p| p.segment() == id) {
            return fault(format!("segment {id} has a path already"));
        }
    }
    if plan.paths.is_empty() {
        return Ok(Vec::new());
    }
    let mut solids = Vec::with_capacity(n);
    for segment in &osteotomy.segments {
        control.check()?;
        solids.push((segment.id, Solid::new(segment)));
    }
    control.report(0.3);
    let mut reports = Vec::with_capacity(plan.paths.len());
    for (i, path) in plan.paths.iter().enumerate() {
        if let Some(segment) = osteotomy.segments.iter().find(|s| s.id == path.segment()) {
            reports.push(follow_one(segment, path, plan, &solids, control)?);
        }
        control.report(0.3 + 0.7 * (i + 1) as f64 / plan.paths.len() as f64);
    }
    Ok(reports)
}

fn follow_one(
    segment: &Segment,
    path: &Path,
    plan: &Plan,
    solids: &[(u32, Option<Solid>)],
    control: &Control,
) -> Result<PathReport, PlanError> {
    let positions = segment.surface.positions();
    let stride = positions.len().div_ceil(PROBES).max(1);
    let probes: Vec<Point> = positions.iter().copied().step_by(stride).collect();
    let others: Vec<(u32, &Solid)> =
        solids.iter().filter(|(id, _)| *id != segment.id).filter_map(|(id, s)| Some((*id, s.as_ref()?))).collect();
    let edge = (segment.area_mm2 / segment.surface.triangles().len() as f64 * 4.0 / 3.0f64.sqrt()).sqrt();

    let rest = nearest_bone(&probes, &Motion::identity(), &others, |_| Motion::identity(), control)?;
    let on_cap: Vec<bool> = rest.iter().map(|d| d.abs() < CAP_SHARE * edge).collect();
    let mut samples: Vec<f64> = (0..=SAMPLES).map(|i| i as f64 / SAMPLES as f64).collect();
    samples.extend(path.waypoints().iter().map(|w| w.0));
    samples.sort_by(f64::total_cmp);
    samples.dedup_by(|a, b| (*a - *b).abs() < 1e-9);

    let mut along = Vec::with_capacity(samples.len());
    for t in samples {
        let motions = plan.motions(t);
        let motion_of = |id: u32| motions.iter().find(|m| m.0 == id).map_or_else(Motion::identity, |m| m.1);
        let distances = nearest_bone(&probes, &motion_of(segment.id), &others, motion_of, control)?;
        let overlap = distances.iter().fold(0.0f64, |deepest, d| deepest.max(-d));
        let (mut sum, mut count) = (0.0, 0usize);
        for (d, _) in distances.iter().zip(&on_cap).filter(|(_, cap)| **cap) {
            sum += d.max(0.0);
            count += 1;
        }
        along.push((t, overlap, if count == 0 { 0.0 } else { sum / count as f64 }));
    }
    let end = path.at(1.0);
    let shift = end * segment.centroid - segment.centroid;
    Ok(PathReport {
        segment: segment.id,
        max_displacement_mm: positions.iter().map(|p| (end * p - p).norm()).fold(0.0, f64::max),
        centroid_displacement_mm: [shift.x, shift.y, shift.z],
        path_length_mm: path.length_mm(&segment.centroid),
        along,
    })
}

/// Signed distance of every probe, moved by `motion`, to the nearest of the `others`, moved by theirs; infinite without others.
fn nearest_bone(
    probes: &[Point],
    motion: &Motion,
    others: &[(u32, &Solid)],
    motion_of: impl Fn(u32) -> Motion,
    control: &Control,
) -> Result<Vec<f64>, Cancelled> {
    control.check()?;
    let frames: Vec<(&Solid, Motion)> = others.iter().map(|(id, s)| (*s, motion_of(*id).inverse() * motion)).collect();
    let nearest = |p: &Point| frames.iter().map(|(s, m)| s.signed(&(m * p))).fold(f64::INFINITY, f64::min);
    Ok(probes.par_iter().with_min_len(256).map(nearest).collect())
}

/// A closed surface with signed distances: sign by the pseudonormal of the closest feature.
struct Solid(Shape);

impl Solid {
    fn new(segment: &Segment) -> Option<Self> {
        let vertices = segment.surface.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
        let triangles = segment.surface.triangles().to_vec();
        Shape::with_flags(vertices, triangles, TriMeshFlags::ORIENTED).ok().map(Self)
    }

    fn signed(&self, p: &Point) -> f64 {
        let p = ParryVector::new(p.x, p.y, p.z);
        let projection = self.0.project_local_point(p, false);
        let distance = (projection.point - p).length();
        if projection.is_inside { -distance } else { distance }
    }
}
