//! What a segment meets on its path.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};
use rayon::prelude::*;

use super::{Osteotomy, Path, Plan, PlanError, Segment, overlap};
use crate::control::{Cancelled, Control};
use crate::geometry::{Motion, Point, Vector};

/// Samples along a path, besides its waypoints.
const SAMPLES: usize = 10;
/// At most about this many vertices of a segment are tested against other bone.
const PROBES: usize = 6000;
/// Bone farther away is not what a cut face has left, mm.
const FAR_MM: f64 = 30.0;
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
    /// What it meets, by rising t.
    pub along: Vec<PathSample>,
}

/// What a segment meets at one place of its path.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PathSample {
    /// Path parameter.
    pub t: f64,
    /// Deepest overlap with other bone, mm; 0 when none.
    pub overlap_mm: f64,
    /// Volume that the segment shares with other bone, mm³.
    pub overlap_mm3: f64,
    /// Mean gap opened at the cut faces, mm.
    pub gap_mm: f64,
    /// Volume between the cut faces and the bone that lies straight in front of them within 30 mm, mm³.
    pub gap_mm3: f64,
}

/// Follows every path, at t = 0, 0.1, … 1 and at its waypoints.
///
/// Overlap and gap are measured at up to 6000 or so vertices of the segment, evenly picked by number, against the surfaces
/// of all other segments where they are at that t. Cut faces are the vertices that touch another segment at rest; the gap
/// is the mean over them of the distance to the nearest other bone, 0 where they overlap: a face that slides along
/// another has no gap. The volume of the gap is that of the prisms from the cut faces, along their outward normals, to the
/// bone that they meet; faces that meet none count for nothing. Both volumes are integrals, the overlap's over cells of about a millimetre
/// in which bone's surfaces are taken to be plane.
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

    let faces = CutFaces::new(segment, &others, CAP_SHARE * edge);
    let own = solids.iter().find(|(id, _)| *id == segment.id).and_then(|(_, s)| s.as_ref());
    let mut along = Vec::with_capacity(samples.len());
    for t in samples {
        let motions = plan.motions(t);
        let motion_of = |id: u32| motions.iter().find(|m| m.0 == id).map_or_else(Motion::identity, |m| m.1);
        let motion = motion_of(segment.id);
        let distances = nearest_bone(&probes, &motion, &others, motion_of, control)?;
        let overlap_mm = distances.iter().fold(0.0f64, |deepest, d| deepest.max(-d));
        let (mut sum, mut count) = (0.0, 0usize);
        for (d, _) in distances.iter().zip(&on_cap).filter(|(_, cap)| **cap) {
            sum += d.max(0.0);
            count += 1;
        }
        let frames: Vec<(&Solid, Motion)> =
            others.iter().map(|(id, s)| (*s, motion_of(*id).inverse() * motion)).collect();
        let overlap_mm3 = own
            .map_or(0.0, |own| frames.iter().map(|(s, m)| overlap::volume(own, s, m, &segment.surface.bounds())).sum());
        let gap_mm = if count == 0 { 0.0 } else { sum / count as f64 };
        along.push(PathSample { t, overlap_mm, overlap_mm3, gap_mm, gap_mm3: faces.gap(&frames) });
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

/// Cut faces of a segment: middles of triangles, outward unit normals, areas.
struct CutFaces(Vec<(Point, Vector, f64)>);

impl CutFaces {
    /// Triangles of which two corners and more touch other bone at rest: at the rim the third may not.
    fn new(segment: &Segment, others: &[(u32, &Solid)], touch: f64) -> Self {
        let mesh = &segment.surface;
        let touches = |p: &Point| others.iter().any(|(_, s)| s.signed(p).abs() < touch);
        let on_cap: Vec<bool> = mesh.positions().par_iter().with_min_len(256).map(touches).collect();
        let faces = (0..mesh.triangles().len())
            .filter(|t| mesh.triangles()[*t].iter().filter(|v| on_cap[**v as usize]).count() >= 2);
        let face = |t: usize| {
            let [a, b, c] = mesh.corners(t);
            let normal = mesh.scaled_normal(t);
            let middle = Point::from((a.coords + b.coords + c.coords) / 3.0);
            (middle, normal.normalize(), 0.5 * normal.norm())
        };
        Self(faces.map(face).filter(|f| f.2 > 0.0).collect())
    }

    /// Volume between the faces and the bone that they face; `frames` are other bones with the motions into their frames.
    fn gap(&self, frames: &[(&Solid, Motion)]) -> f64 {
        let reach = |(p, n, area): &(Point, Vector, f64)| {
            let hit = frames.iter().filter_map(|(s, m)| s.ahead(&(m * p), &(m * n)));
            hit.min_by(f64::total_cmp).map_or(0.0, |d| d * area)
        };
        // Summed in order: the same on any number of threads.
        let volumes: Vec<f64> = self.0.par_iter().with_min_len(256).map(reach).collect();
        volumes.iter().sum()
    }
}

/// A closed surface with signed distances: sign by the pseudonormal of the closest feature.
pub(super) struct Solid(Shape);

impl Solid {
    fn new(segment: &Segment) -> Option<Self> {
        let vertices = segment.surface.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
        let triangles = segment.surface.triangles().to_vec();
        Shape::with_flags(vertices, triangles, TriMeshFlags::ORIENTED).ok().map(Self)
    }

    fn signed(&self, p: &Point) -> f64 {
        self.signed_towards(p).0
    }

    /// Signed distance of `p`, and the outward unit direction there; zero on the surface itself.
    pub(super) fn signed_towards(&self, p: &Point) -> (f64, Vector) {
        let q = ParryVector::new(p.x, p.y, p.z);
        let projection = self.0.project_local_point(q, false);
        let off = q - projection.point;
        let (distance, off) = (off.length(), Vector::new(off.x, off.y, off.z));
        let sign = if projection.is_inside { -1.0 } else { 1.0 };
        (sign * distance, off.try_normalize(1e-12).map_or_else(Vector::zeros, |u| u * sign))
    }

    /// Distance along unit `n` from `p`, outside or on the surface, to where the surface is entered.
    fn ahead(&self, p: &Point, n: &Vector) -> Option<f64> {
        // From a little behind, so that a face in contact meets the other one.
        const BEHIND_MM: f64 = 0.2;
        let from = p - n * BEHIND_MM;
        let ray = Ray::new(ParryVector::new(from.x, from.y, from.z), ParryVector::new(n.x, n.y, n.z));
        let hit = self.0.cast_local_ray_and_get_normal(&ray, FAR_MM + BEHIND_MM, false)?;
        let entered = hit.normal.dot(ray.dir) < 0.0;
        entered.then_some((hit.time_of_impact - BEHIND_MM).max(0.0))
    }
}
