//! Measurements of a prediction that need the patient's bone.

use super::Case;
use prosopon_contract::Halt;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh};
use prosopon_planning::evaluate::{Clinical, ClinicalInput, MovedBone, clinical};
use prosopon_planning::plan::{Osteotomy, propose};

/// All segments, each with its motion from rest.
pub(super) fn moved_bones<'a>(osteotomy: &'a Osteotomy, motions: &[(u32, Motion)]) -> Vec<MovedBone<'a>> {
    let motion = |id: u32| motions.iter().find(|(s, _)| *s == id).map_or_else(Motion::identity, |(_, m)| *m);
    osteotomy.segments.iter().map(|s| MovedBone { surface: &s.surface, motion: motion(s.id) }).collect()
}

/// Measures the skin in a surgeon's terms, from `rest` to `moved`; landmarks that the case lacks are proposed.
pub(super) fn clinical_of(
    case: &Case,
    bones: &[MovedBone<'_>],
    [rest, moved]: [&TriMesh; 2],
    control: &Control,
) -> Result<Clinical, Halt> {
    let anatomy = &case.anatomy;
    let proposal = propose(&anatomy.skin, &anatomy.skull);
    control.check()?;
    let input = ClinicalInput {
        rest,
        moved,
        given: &anatomy.landmarks,
        proposed: &proposal.points,
        midline_x_mm: case.midline_x_mm.unwrap_or(proposal.midline_x_mm),
        bones,
    };
    Ok(clinical(&input, control)?)
}
