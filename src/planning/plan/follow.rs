//! Overlap and gap between segments along their paths.

use rayon::prelude::*;

use super::cut_faces::CutFaces;
use super::moved_solid::{MovedSolid, Solid, nearest_bone};
use super::tuning::{
    BONE_OVERLAP_MM, BONE_OVERLAP_MM3, MAX_SAWN_OVERLAP_MM, MAX_USUAL_MOVE_MM, MAX_USUAL_TURN_DEG, PATH_SAMPLES,
    PROBES, WIDE_GAP_MM,
};
use super::{Osteotomy, Path, Plan, PlanError, Segment, overlap};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Warning};

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
    /// Unusually large motions, overlap with other bone at the end, wide gaps.
    pub warnings: Vec<Warning>,
}

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
/// - Gap volume: a prism stands on each cut face and reaches along its outward normal to the first bone, at most 30 mm. It counts
///   where it ends on a cut face of another segment, not where it ends elsewhere (at the roof of a sinus) or meets no bone.
/// - Overlap volume: an integral over cells of at most about 1 mm, in which the surfaces are taken to be plane.
///
/// # Errors
/// [`PlanError::Value`] when a path names a segment that does not exist, segment 0, or one that has a path already;
/// [`PlanError::Cancelled`].
pub fn follow(osteotomy: &Osteotomy, plan: &Plan, control: &Control) -> Result<Vec<PathReport>, PlanError> {
    check_paths(osteotomy, plan)?;
    if plan.paths.is_empty() {
        return Ok(Vec::new());
    }
    let mut solids = Vec::with_capacity(osteotomy.segments.len());
    for segment in &osteotomy.segments {
        control.check()?;
        if let Some(solid) = Solid::new(segment) {
            solids.push((segment.id, solid));
        }
    }
    let faces = CutFaces::of(osteotomy, &solids, control)?;
    control.report(0.3);
    let follower = Follower { osteotomy, plan, solids, faces };
    let mut reports = Vec::with_capacity(plan.paths.len());
    for (i, path) in plan.paths.iter().enumerate() {
        if let Some(segment) = osteotomy.segments.iter().find(|s| s.id == path.segment()) {
            reports.push(follower.report(segment, path, control)?);
        }
        control.report(0.3 + 0.7 * (i + 1) as f64 / plan.paths.len() as f64);
    }
    Ok(reports)
}

/// Displacement of every moving segment; overlap and gap, which take a second, are left out and `along` is empty.
///
/// # Errors
/// [`PlanError::Value`] as [`follow`].
pub fn outline(osteotomy: &Osteotomy, plan: &Plan) -> Result<Vec<PathReport>, PlanError> {
    check_paths(osteotomy, plan)?;
    let of_path = |path: &Path| {
        let segment = osteotomy.segments.iter().find(|s| s.id == path.segment())?;
        Some(displacement(segment, path))
    };
    Ok(plan.paths.iter().filter_map(of_path).collect())
}

/// Report without overlap and gap.
fn displacement(segment: &Segment, path: &Path) -> PathReport {
    let positions = segment.surface.positions();
    let end = path.at(1.0);
    let shift = end * segment.centroid - segment.centroid;
    let farthest = |m: &Motion| positions.iter().map(|p| (m * p - p).norm()).fold(0.0, f64::max);
    let reached = |of: &dyn Fn(&Motion) -> f64| path.waypoints().iter().map(|w| of(&w.1)).fold(0.0, f64::max);
    let turned_deg = reached(&|m| m.rotation.angle()).to_degrees();
    PathReport {
        segment: segment.id,
        max_displacement_mm: farthest(&end),
        centroid_displacement_mm: [shift.x, shift.y, shift.z],
        path_length_mm: path.length_mm(&segment.centroid),
        warnings: motion_warnings(&segment.label(), reached(&farthest), turned_deg),
        along: Vec::new(),
    }
}

/// Refuses paths of segments that cannot move, and second paths of a segment.
fn check_paths(osteotomy: &Osteotomy, plan: &Plan) -> Result<(), PlanError> {
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
    Ok(())
}

/// The segments of an osteotomy on the paths of a plan.
struct Follower<'a> {
    osteotomy: &'a Osteotomy,
    plan: &'a Plan,
    solids: Vec<(u32, Solid)>,
    faces: CutFaces,
}

/// Where a segment lies deepest in another one.
struct Deepest {
    /// Number of the other segment.
    other: u32,
    /// LPS mm.
    at: Point,
}

/// A segment at one t of its path.
struct Sampled {
    sample: PathSample,
    /// `None` when it lies in no other segment.
    deepest: Option<Deepest>,
}

impl Follower<'_> {
    /// Report of one segment along its path.
    fn report(&self, segment: &Segment, path: &Path, control: &Control) -> Result<PathReport, PlanError> {
        let positions = segment.surface.positions();
        let stride = positions.len().div_ceil(PROBES).max(1);
        let probes: Vec<Point> = positions.iter().copied().step_by(stride).collect();
        let (mut along, mut deepest) = (Vec::new(), None);
        for t in samples(path) {
            control.check()?;
            // Each sample replaces it, so that the last one, the end of the path, remains.
            let sampled = self.sample(segment, &probes, t);
            deepest = sampled.deepest;
            along.push(sampled.sample);
        }
        let mut report = displacement(segment, path);
        if let Some(end) = along.last() {
            report.warnings.extend(deepest.and_then(|deepest| self.overlap_warning(segment, end, &deepest)));
            report.warnings.extend(gap_warning(&segment.label(), end));
        }
        Ok(PathReport { along, ..report })
    }

    /// Overlap and gap of `segment` at `t`, and where it lies deepest in another segment, if it does.
    fn sample(&self, segment: &Segment, probes: &[Point], t: f64) -> Sampled {
        let motions = self.plan.motions(t);
        let motion_of = |id: u32| motions.iter().find(|m| m.0 == id).map_or_else(Motion::identity, |m| m.1);
        let motion = motion_of(segment.id);
        let others: Vec<MovedSolid<'_>> = (self.solids.iter())
            .filter(|(id, _)| *id != segment.id)
            .map(|(id, solid)| MovedSolid { segment: *id, solid, own_from_moving: motion_of(*id).inverse() * motion })
            .collect();
        let distances: Vec<f64> = probes.par_iter().with_min_len(256).map(|p| nearest_bone(p, &others)).collect();
        let overlap_mm = distances.iter().fold(0.0f64, |deepest, d| deepest.max(-d));
        let deepest = probes.iter().zip(&distances).min_by(|a, b| a.1.total_cmp(b.1)).filter(|(_, d)| **d < 0.0);
        let deepest = deepest.and_then(|(p, _)| {
            let other = others.iter().min_by(|a, b| a.signed(p).total_cmp(&b.signed(p)))?;
            Some(Deepest { other: other.segment, at: motion * p })
        });
        let own = self.solids.iter().find(|(id, _)| *id == segment.id).map(|(_, solid)| solid);
        let bounds = segment.surface.bounds();
        let shared = |own| others.iter().map(|o| overlap::volume(own, o.solid, &o.own_from_moving, &bounds)).sum();
        let overlap_mm3 = own.map_or(0.0, shared);
        let gap = self.faces.gap(segment.id, &others);
        let sample = PathSample { t, overlap_mm, overlap_mm3, gap_mm: gap.mean_mm, gap_mm3: gap.volume_mm3 };
        Sampled { sample, deepest }
    }

    /// Warning about a segment that ends inside another one.
    fn overlap_warning(&self, segment: &Segment, end: &PathSample, deepest: &Deepest) -> Option<Warning> {
        if end.overlap_mm <= BONE_OVERLAP_MM || end.overlap_mm3 <= BONE_OVERLAP_MM3 {
            return None;
        }
        let found = self.osteotomy.segments.iter().find(|s| s.id == deepest.other);
        let other = found.map_or_else(|| format!("segment {}", deepest.other), Segment::label);
        let message = format!(
            "{} ends {:.1} mm deep in {other} at [{:.1}, {:.1}, {:.1}] mm; {:.0} mm³ of bone would have to be removed",
            segment.label(),
            end.overlap_mm,
            deepest.at.x,
            deepest.at.y,
            deepest.at.z,
            end.overlap_mm3
        );
        Some(if end.overlap_mm <= MAX_SAWN_OVERLAP_MM {
            Warning::info("bone-overlap", message)
        } else {
            Warning::check("bone-overlap", message).act("Plan to remove this bone, or change the path.")
        })
    }
}

/// Sampled t of a path, ascending: evenly spaced ones and its waypoints.
fn samples(path: &Path) -> Vec<f64> {
    let mut samples: Vec<f64> = (0..=PATH_SAMPLES).map(|i| i as f64 / PATH_SAMPLES as f64).collect();
    samples.extend(path.waypoints().iter().map(|w| w.0));
    samples.sort_by(f64::total_cmp);
    samples.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    samples
}

/// Warnings about the largest displacement and rotation along a path.
fn motion_warnings(segment: &str, moved_mm: f64, turned_deg: f64) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if moved_mm > MAX_USUAL_MOVE_MM {
        let message = format!(
            "{segment} moves {moved_mm:.1} mm at its furthest point; more than {MAX_USUAL_MOVE_MM} mm is unusual"
        );
        warnings.push(Warning::check("large-displacement", message).act("Check the path."));
    }
    if turned_deg > MAX_USUAL_TURN_DEG {
        let message =
            format!("{segment} turns by {turned_deg:.1} degrees; more than {MAX_USUAL_TURN_DEG} degrees is unusual");
        warnings.push(Warning::check("large-rotation", message).act("Check the path."));
    }
    warnings
}

/// Warning about a wide gap at the cut faces of a segment at the end of its path.
fn gap_warning(segment: &str, end: &PathSample) -> Option<Warning> {
    (end.gap_mm > WIDE_GAP_MM).then(|| {
        let message = format!(
            "the cut faces of {segment} end {:.1} mm apart on average, with {:.0} mm³ between them",
            end.gap_mm, end.gap_mm3
        );
        Warning::check("wide-gap", message).act("Plan a graft, or change the path.")
    })
}
