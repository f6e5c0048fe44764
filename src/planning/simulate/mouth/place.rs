use super::tuning::{FROM_INCISORS_MM, FROM_STOMION_MM, PROFILE_SHARES};
use super::{Face, Reason};
use crate::plan::{Proposal, propose};
use prosopon_geometry::Point;

/// Where the crease between the lips is looked for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    /// x of the midline, mm.
    pub(super) midline: f64,
    /// Lowest and highest z in the midline, mm.
    pub(super) heights: [f64; 2],
    /// The right and the left commissure, where they are known.
    pub(super) commissures: [Option<Point>; 2],
    pub(super) source: Source,
}

/// What the place was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// The landmark of the midline between the lips.
    Stomion,
    /// The edge of the upper incisors, a landmark or proposed.
    Incisors,
    /// Subnasale and the soft chin, landmarks or proposed.
    Profile,
}

/// Place of the mouth from the landmarks, then from proposed ones.
pub(super) fn place(face: &Face<'_>) -> Result<Place, Reason> {
    let given = |name: &str| face.landmarks.iter().find(|(n, _)| n == name).map(|(_, p)| *p);
    let commissures = [given("cheilion_right"), given("cheilion_left")];
    if let Some(stomion) = given("stomion") {
        let heights = [stomion.z - FROM_STOMION_MM, stomion.z + FROM_STOMION_MM];
        return Ok(Place { midline: stomion.x, heights, commissures, source: Source::Stomion });
    }
    let proposed: Proposal = propose(face.skin, face.skull);
    let point = |name: &str| given(name).or_else(|| proposed.points.get(name).copied());
    let profile = match (point("subnasale"), point("soft_pogonion")) {
        (Some(nose), Some(chin)) if nose.z > chin.z => {
            let at = |share: f64| nose.z + share * (chin.z - nose.z);
            Some((nose.x, [at(PROFILE_SHARES[1]), at(PROFILE_SHARES[0])]))
        }
        _ => None,
    };
    if let Some(edge) = point("incisor_upper") {
        let mut heights = FROM_INCISORS_MM.map(|by| edge.z + by);
        // Both must hold, if they can.
        if let Some((_, [low, high])) = profile
            && heights[0].max(low) < heights[1].min(high)
        {
            heights = [heights[0].max(low), heights[1].min(high)];
        }
        return Ok(Place { midline: edge.x, heights, commissures, source: Source::Incisors });
    }
    let (midline, heights) = profile.ok_or(
        "neither `stomion`, `incisor_upper` nor `subnasale` with `soft_pogonion` are given or could be proposed",
    )?;
    Ok(Place { midline, heights, commissures, source: Source::Profile })
}
