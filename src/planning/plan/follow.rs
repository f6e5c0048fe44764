//! Overlap and gap between segments along their paths.

use rayon::prelude::*;

use super::cut_faces::{CutFaces, Solid};
use super::{Osteotomy, Path, Plan, PlanError, Segment, overlap};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point};

/// Evenly spaced samples along a path, in addition to its waypoints.
const SAMPLES: usize = 10;
/// At most about this many vertices of a segment are tested against other bone.
const PROBES: usize = 6000;

/// Displacements of one segment, and its overlap and gap along its path.
#[derive(Debug, Clone, PartialEq)]
pub struct PathReport {
    /// Number of the segment.
    pub segment: u32,
    /// Largest displacement of a point of the segment at the end, mm.
    pub max_displacement_mm: f64,
    /// Displacement of its centroid at the end, LPS mm.
    pub centroid_displacement_mm: [f64; 3],
    /// Length of the centroid's path, mm.
    pub path_length_mm: f64,
    /// Overlap and gap at each sampled t, ascending.
    pub along: Vec<PathSample>,
    /// Warnings for the surgeon: unusually large motions, overlap with other bone at the end, wide gaps.
    pub warnings: Vec<String>,
}

/// Movements above this are warned of, mm: bone is hardly ever moved further.
const MOST_MOVED_MM: f64 = 20.0;
/// Rotations above this are warned of, degrees: bone is hardly ever turned further.
const MOST_TURNED_DEG: f64 = 20.0;
/// Overlap at the end below this depth (mm) or this volume (mm³) is not warned of: a saw and a file remove as much.
const OVERLAP: (f64, f64) = (1.0, 100.0);
/// Mean gap between cut faces above which a graft is needed, mm.
const WIDE_GAP_MM: f64 = 5.0;

/// Overlap and gap of a segment at one t of its path.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PathSample {
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Deepest overlap with other bone, mm; 0 when none.
    pub overlap_mm: f64,
    /// Volume that the segment shares with other bone, mm³.
    pub overlap_mm3: f64,
    /// Mean gap at the cut faces, mm.
    pub gap_mm: f64,
    /// Volume between the cut faces and those of other segments that lie straight in front of them within 30 mm, mm³.
    pub gap_mm3: f64,
}

/// Measures overlap and gap of every moving segment along its path.
///
/// Samples lie at t = 0, 0.1, … 1 and at the waypoints; reports are in the order of the paths.
///
/// - Overlap depth: at up to 6000 vertices of the segment, evenly picked by number, against the surfaces of all other segments at
///   the same t.
/// - Cut faces: the triangles that face another segment at rest, in contact or across the kerf.
/// - Mean gap: the mean over the cut faces of the distance to the nearest other bone, 0 where they overlap. A face that slides
///   along another has no gap.
/// - Gap volume: that of the prisms from the cut faces, along their outward normals, to the cut faces opposite. A prism that
///   meets other bone (the roof of a sinus) or no bone counts as 0.
/// - Overlap volume: an integral over cells of at most about 1 mm, in which the surfaces are taken to be plane.
///
/// # Errors
/// [`PlanError::Value`] when a path names a segment that does not exist, segment 0, or one that has a path already;
/// [`PlanError::Cancelled`].
pub fn follow(osteotomy: &Osteotomy, plan: &Plan, control: &Control) -> Result<Vec<PathReport>, PlanError> {
    let n = osteotomy.segments.len();
    for (i, path) in plan.paths.iter().enumerate() {
        let id = path.segment();
        let fault = |detail: String| Err(PlanError::Value { what: format!("paths[{i}].segment"), detail });
        if id == 0 || !osteotomy.segments.iter().any(|s| s.id == id) {
            return fault(format!("is {id}, but only segments 1 to {} can move", n.saturating_sub(1)));
        }
        if plan.paths[..i].iter().any(|p| p.segment() == id) {
            return fault(format!("segment {id} already has a path; give one path for each segment"));
        }
    }
    if plan.paths.is_empty() {
        return Ok(Vec::new());
    }
    let mut solids = Vec::with_capacity(n);
    for segment in &osteotomy.segments {
        control.check()?;
        if let Some(solid) = Solid::new(segment) {
            solids.push((segment.id, solid));
        }
    }
    let kerf_mm = osteotomy.cuts.iter().map(|c| c.kerf_mm).fold(0.0, f64::max);
    let faces = CutFaces::of(&osteotomy.segments, &solids, kerf_mm, control)?;
    control.report(0.3);
    let mut reports = Vec::with_capacity(plan.paths.len());
    for (i, path) in plan.paths.iter().enumerate() {
        if let Some(segment) = osteotomy.segments.iter().find(|s| s.id == path.segment()) {
            reports.push(follow_one(osteotomy, segment, (path, plan), &solids, &faces, control)?);
        }
        control.report(0.3 + 0.7 * (i + 1) as f64 / plan.paths.len() as f64);
    }
    Ok(reports)
}

fn follow_one(
    osteotomy: &Osteotomy,
    segment: &Segment,
    (path, plan): (&Path, &Plan),
    solids: &[(u32, Solid)],
    faces: &CutFaces,
    control: &Control,
) -> Result<PathReport, PlanError> {
    let positions = segment.surface.positions();
    let stride = positions.len().div_ceil(PROBES).max(1);
    let probes: Vec<Point> = positions.iter().copied().step_by(stride).collect();
    let others: Vec<(u32, &Solid)> =
        solids.iter().filter(|(id, _)| *id != segment.id).map(|(id, solid)| (*id, solid)).collect();
    let own = solids.iter().find(|(id, _)| *id == segment.id).map(|(_, solid)| solid);
    let mut samples: Vec<f64> = (0..=SAMPLES).map(|i| i as f64 / SAMPLES as f64).collect();
    samples.extend(path.waypoints().iter().map(|w| w.0));
    samples.sort_by(f64::total_cmp);
    samples.dedup_by(|a, b| (*a - *b).abs() < 1e-9);

    let (mut along, mut overlapped) = (Vec::with_capacity(samples.len()), None);
    for t in samples {
        control.check()?;
        let motions = plan.motions(t);
        let motion_of = |id: u32| motions.iter().find(|m| m.0 == id).map_or_else(Motion::identity, |m| m.1);
        let motion = motion_of(segment.id);
        let frames: Vec<Frame<'_>> =
            others.iter().map(|(id, solid)| (*id, *solid, motion_of(*id).inverse() * motion)).collect();
        let distances: Vec<f64> = probes.par_iter().with_min_len(256).map(|p| nearest_bone(p, &frames)).collect();
        let overlap_mm = distances.iter().fold(0.0f64, |deepest, d| deepest.max(-d));
        let deepest = probes.iter().zip(&distances).min_by(|a, b| a.1.total_cmp(b.1));
        // Each sample replaces it, so that the last one, the end of the path, remains.
        overlapped = deepest.filter(|(_, d)| **d < 0.0).and_then(|(p, _)| {
            let by = |frame: &&Frame<'_>| frame.1.signed(&(frame.2 * p));
            let other = frames.iter().min_by(|a, b| by(a).total_cmp(&by(b)))?;
            Some((other.0, motion * p))
        });
        let shared = |own| frames.iter().map(|(_, s, m)| overlap::volume(own, s, m, &segment.surface.bounds())).sum();
        let overlap_mm3 = own.map_or(0.0, shared);
        let (gap_mm, gap_mm3) = faces.gap(segment.id, &frames);
        along.push(PathSample { t, overlap_mm, overlap_mm3, gap_mm, gap_mm3 });
    }
    let label = |id: u32| {
        let found = osteotomy.segments.iter().find(|s| s.id == id);
        found.map_or_else(|| format!("segment {id}"), Segment::label)
    };
    let end = path.at(1.0);
    let shift = end * segment.centroid - segment.centroid;
    let max_displacement_mm = positions.iter().map(|p| (end * p - p).norm()).fold(0.0, f64::max);
    let reached = |most: &dyn Fn(&Motion) -> f64| path.waypoints().iter().map(|w| most(&w.1)).fold(0.0, f64::max);
    let furthest_mm = reached(&|m| positions.iter().map(|p| (m * p - p).norm()).fold(0.0, f64::max));
    let turned_deg = reached(&|m| m.rotation.angle()).to_degrees();
    Ok(PathReport {
        segment: segment.id,
        max_displacement_mm,
        centroid_displacement_mm: [shift.x, shift.y, shift.z],
        path_length_mm: path.length_mm(&segment.centroid),
        warnings: doubts(
            &segment.label(),
            furthest_mm,
            turned_deg,
            along.last(),
            overlapped.map(|(id, at)| (label(id), at)),
        ),
        along,
    })
}

/// Warnings about the largest movement along a path and about overlap and gap at its end.
///
/// - `overlapped`: name of the segment in which this one lies deepest at the end, and the deepest point, LPS mm
fn doubts(
    segment: &str,
    moved_mm: f64,
    turned_deg: f64,
    end: Option<&PathSample>,
    overlapped: Option<(String, Point)>,
) -> Vec<String> {
    let mut doubts = Vec::new();
    if moved_mm > MOST_MOVED_MM {
        doubts.push(format!(
            "{segment} moves {moved_mm:.1} mm at its furthest point; more than {MOST_MOVED_MM} mm is unusual, check the path"
        ));
    }
    if turned_deg > MOST_TURNED_DEG {
        doubts.push(format!(
            "{segment} turns by {turned_deg:.1} degrees; more than {MOST_TURNED_DEG} is unusual, check it"
        ));
    }
    let Some(end) = end else { return doubts };
    if let Some((other, at)) = overlapped.filter(|_| end.overlap_mm > OVERLAP.0 && end.overlap_mm3 > OVERLAP.1) {
        doubts.push(format!(
            "{segment} ends {:.1} mm deep in {other} at [{:.1}, {:.1}, {:.1}] mm; remove {:.0} mm³ of bone or change the path",
            end.overlap_mm, at.x, at.y, at.z, end.overlap_mm3
        ));
    }
    if end.gap_mm > WIDE_GAP_MM {
        doubts.push(format!(
            "the cut faces of {segment} end {:.1} mm apart on average; plan a graft of {:.0} mm³ or change the path",
            end.gap_mm, end.gap_mm3
        ));
    }
    doubts
}

/// Number and solid of another segment, and the motion from the moving segment's rest frame into the other's.
pub(super) type Frame<'a> = (u32, &'a Solid, Motion);

/// Signed distance from `p`, in the moving segment's rest frame, to the nearest other bone, mm; infinite without others.
pub(super) fn nearest_bone(p: &Point, frames: &[Frame<'_>]) -> f64 {
    frames.iter().map(|(_, solid, motion)| solid.signed(&(motion * p))).fold(f64::INFINITY, f64::min)
}
