//! Globes along a plan: which bone is pressed into them, and where they are missing.

use super::globes::Globe;
use super::tuning::PRESSED_MM;
use super::{CutBone, TissueModel};
use crate::plan::{Plan, Segment};
use prosopon_geometry::{Motion, Point, Severity, Warning};

/// Instants of a path at which bone is compared with the globes, besides its waypoints.
const INSTANTS: u32 = 20;

/// Findings about the globes of a solve that its mesh does not know: what moves, and how far.
///
/// Says which moving bone is pressed how deep into which globe along the plan, and that globes are missing where they are
/// needed, for a mesh that was built without knowing the cuts.
#[must_use]
pub fn globe_warnings(tissue: &TissueModel, bone: &CutBone, plan: &Plan) -> Vec<Warning> {
    let near = bone.boxes_near_orbits(|id| plan.paths.iter().any(|p| p.segment() == id));
    let unknown = |w: &&Warning| w.code == "globes-not-placed" && w.severity == Severity::Info && !near.is_empty();
    let missing = tissue.report.warnings.iter().filter(unknown);
    let missing = missing.map(|w| Warning { severity: Severity::Check, ..w.clone() });
    missing.chain(pressed(&tissue.globes, bone, plan)).collect()
}

/// Says which moving bone comes deeper into which globe than it is at rest.
pub(super) fn pressed(globes: &[Globe], bone: &CutBone, plan: &Plan) -> Vec<Warning> {
    let turns = plan.paths.iter().flat_map(|path| path.waypoints().iter().map(|w| w.0));
    let instants: Vec<f64> = (1..=INSTANTS).map(|k| f64::from(k) / f64::from(INSTANTS)).chain(turns).collect();
    let moved: Vec<(f64, Vec<(u32, Motion)>)> = instants.iter().map(|t| (*t, plan.motions(*t))).collect();
    let pairs = globes.iter().flat_map(|globe| bone.osteotomy.segments.iter().map(move |segment| (globe, segment)));
    let deepest = pairs.filter_map(|(globe, segment)| {
        // Each point against itself: bone that is in the globe at rest excuses no other.
        let deeper = |p: &Point, motion: &Motion| globe.distance(p).min(0.0) - globe.distance(&(motion * p));
        let of = |motion: &Motion| segment.surface.positions().iter().map(|p| deeper(p, motion)).fold(0.0, f64::max);
        let motions = moved.iter().filter_map(|(t, all)| Some((*t, all.iter().find(|m| m.0 == segment.id)?.1)));
        let (depth, t) = motions.map(|(t, m)| (of(&m), t)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        (depth > PRESSED_MM).then_some((globe, segment, depth, t))
    });
    let warning = |(globe, segment, depth, t): (&Globe, &Segment, f64, f64)| {
        let [x, y, z] = globe.center.coords.into();
        let message = format!(
            "{} comes {depth:.1} mm deep into the globe at ({x:.0}, {y:.0}, {z:.0}) mm, at {t:.2} of its path; the globe gives \
             no way, so tissue between them is crushed",
            segment.label()
        );
        let action = "Check which walls of the orbit the cuts take along; shorten the path, or build the mesh with \
                      `globes: false`.";
        Warning::check("globe-pressed", message).act(action)
    };
    deepest.map(warning).collect()
}
