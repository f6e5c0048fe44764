use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Motion, Point};
use prosopon_planning::evaluate::{BeforeAfter, Clinical, NamedPoint, NoRatio, ProfilePiece, SoftToHard};

/// Movement of a named point from rest to the end of the path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NamedPointDocument {
    /// Name, as in the landmarks; `columella` is the foremost point of the columella.
    pub name: String,
    /// Position at rest, LPS mm.
    pub position_mm: [f64; 3],
    /// The same seen from the side, where the profile is: to the back and up from the origin of the head's frame, mm. Absent in reports of
    /// earlier versions, whose profile lay in LPS.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side_yz_mm: Option<[f64; 2]>,
    /// Movement forward in the frame of the head, mm.
    pub forward_mm: f64,
    /// Movement down in the frame of the head, mm.
    pub down_mm: f64,
    /// Movement to the patient's left in the frame of the head, mm.
    pub left_mm: f64,
    /// Whether the point was found by the program and no person has confirmed it.
    pub proposed: bool,
}

/// Movement of a soft point in proportion to the bone or tooth below it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SoftToHardDocument {
    /// Name of the soft point.
    pub soft: String,
    /// Name of the hard point; null when none is known.
    pub hard: Option<String>,
    /// Movement of the soft point along the movement of the hard point, as a share of that; null with a `reason`.
    pub ratio: Option<f64>,
    /// Why there is no ratio; absent when there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

impl NamedPointDocument {
    /// Where it lies seen from the side, in the plane of the profile, mm.
    #[must_use]
    pub fn side_mm(&self) -> [f64; 2] {
        let [_, y, z] = self.position_mm;
        self.side_yz_mm.unwrap_or([y, z])
    }
}

/// A piece of the profile line, as points [y, z] to the back and up in the frame of the head, mm; the same points of skin before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProfilePieceDocument {
    /// At rest, from forehead to neck.
    pub before_yz_mm: Vec<[f64; 2]>,
    /// At the end of the path.
    pub after_yz_mm: Vec<[f64; 2]>,
}

/// A value at rest and at the end of the path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BeforeAfterDocument {
    /// At rest.
    pub before: f64,
    /// At the end of the path.
    pub after: f64,
}

/// The prediction in a surgeon's terms: named points, soft-to-hard ratios, profile, angles and gap of the lips.
///
/// A point of skin is followed as a point of the surface; it is not looked for again on the deformed skin. A hard point moves
/// with the segment in which it lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ClinicalDocument {
    /// x of the midsagittal plane, mm.
    pub midline_x_mm: f64,
    /// Whether the midline was found by the program and no person has confirmed it.
    pub midline_proposed: bool,
    /// Points of the skin, from above downwards; those that are not known are left out.
    pub soft_points: Vec<NamedPointDocument>,
    /// Points of bone and teeth, from above downwards; those that are not known are left out.
    pub hard_points: Vec<NamedPointDocument>,
    /// Ratio of each soft point.
    pub ratios: Vec<SoftToHardDocument>,
    /// The skin's line in the midsagittal plane, or up to 3 mm beside it; in two pieces where the lips are parted in the mesh.
    pub profile: Vec<ProfilePieceDocument>,
    /// Angle between columella, subnasale and labrale superius, seen from the side, degrees; null when a point is not known.
    pub nasolabial_deg: Option<BeforeAfterDocument>,
    /// Angle between labrale inferius, sublabiale and soft pogonion, seen from the side, degrees; null when a point is not known.
    pub labiomental_deg: Option<BeforeAfterDocument>,
    /// Height of the upper lip's margin above the lower one's, mm, 0 where they touch; null when the lips were not found.
    pub lip_gap_mm: Option<BeforeAfterDocument>,
    /// Whether the skin is one sheet across the mouth, so that the lips cannot part in this prediction.
    pub mouth_sealed: bool,
}

impl ClinicalDocument {
    /// The document of a measurement in the frame of the head, from which `back` maps to LPS.
    ///
    /// `unconfirmed` names the landmarks that were stored but not confirmed; `midline_given` is whether the midline was stored.
    #[must_use]
    pub fn new(c: &Clinical, back: &Motion, unconfirmed: &[String], midline_given: bool) -> Self {
        let near = c.soft.first().map_or_else(Point::origin, |p| p.rest);
        let is_unconfirmed = |name: &str| unconfirmed.iter().any(|n| n == name);
        let point = |p: &NamedPoint| {
            let moved = p.movement();
            NamedPointDocument {
                name: p.name.to_owned(),
                position_mm: (back * p.rest).coords.into(),
                side_yz_mm: Some(rounded(&[p.rest.y, p.rest.z])),
                forward_mm: -moved.y,
                down_mm: -moved.z,
                left_mm: moved.x,
                proposed: !p.is_given || is_unconfirmed(p.name),
            }
        };
        let both = |v: BeforeAfter| BeforeAfterDocument { before: v.before, after: v.after };
        let piece = |p: &ProfilePiece| ProfilePieceDocument {
            before_yz_mm: p.before.iter().map(rounded).collect(),
            after_yz_mm: p.after.iter().map(rounded).collect(),
        };
        Self {
            midline_x_mm: (back * Point::new(c.midline_x_mm, near.y, near.z)).x,
            midline_proposed: !midline_given || is_unconfirmed("midline_x_mm"),
            soft_points: c.soft.iter().map(point).collect(),
            hard_points: c.hard.iter().map(point).collect(),
            ratios: c.ratios.iter().map(SoftToHardDocument::from).collect(),
            profile: c.profile.iter().map(piece).collect(),
            nasolabial_deg: c.nasolabial_deg.map(both),
            labiomental_deg: c.labiomental_deg.map(both),
            lip_gap_mm: c.lip_gap_mm.map(both),
            mouth_sealed: c.is_mouth_sealed,
        }
    }
}

impl From<&SoftToHard> for SoftToHardDocument {
    fn from(r: &SoftToHard) -> Self {
        let reason = match r.ratio {
            Ok(_) => None,
            Err(NoRatio::NoSoftPoint) => Some("the soft point was not found; set its landmark".to_owned()),
            Err(NoRatio::NoHardPoint) => Some("the bone or tooth below it was not found; set its landmark".to_owned()),
            Err(NoRatio::Still(mm)) => Some(format!("the hard point moves by only {mm:.1} mm")),
        };
        Self { soft: r.soft.to_owned(), hard: r.hard.map(str::to_owned), ratio: r.ratio.ok(), reason }
    }
}

/// A point to the nearest micrometre, so that a report stays small.
fn rounded(p: &[f64; 2]) -> [f64; 2] {
    p.map(|c| (c * 1e3).round() / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_the_surgeons_and_unconfirmed_points_are_proposals() {
        let point = |name, is_given| NamedPoint {
            name,
            rest: Point::new(1.0, -80.0, 10.0),
            moved: Point::new(1.5, -84.0, 8.0),
            is_given,
        };
        let ratio = |ratio| SoftToHard { soft: "subnasale", hard: Some("a_point"), ratio };
        let clinical = Clinical {
            midline_x_mm: 1.0,
            soft: vec![point("pronasale", true), point("subnasale", true), point("sublabiale", false)],
            hard: Vec::new(),
            ratios: vec![ratio(Ok(0.5)), ratio(Err(NoRatio::Still(0.24))), ratio(Err(NoRatio::NoHardPoint))],
            profile: vec![ProfilePiece { before: vec![[-1.00004, 2.0]], after: vec![[-3.0, 2.0]] }],
            nasolabial_deg: None,
            labiomental_deg: Some(BeforeAfter { before: 120.0, after: 130.0 }),
            lip_gap_mm: None,
            is_mouth_sealed: true,
            left_out: Vec::new(),
        };
        let d = ClinicalDocument::new(&clinical, &Motion::identity(), &["subnasale".to_owned()], true);
        let p = &d.soft_points[0];
        assert_eq!((p.forward_mm, p.down_mm, p.left_mm), (4.0, 2.0, 0.5));
        let proposed: Vec<bool> = d.soft_points.iter().map(|p| p.proposed).collect();
        assert_eq!((proposed, d.midline_proposed), (vec![false, true, true], false));
        assert!(ClinicalDocument::new(&clinical, &Motion::identity(), &[], false).midline_proposed);
        assert_eq!((d.ratios[0].ratio, &d.ratios[0].reason), (Some(0.5), &None));
        assert!(d.ratios[1].reason.as_deref().is_some_and(|r| r.contains("0.2 mm")) && d.ratios[1].ratio.is_none());
        assert_eq!(d.profile[0].before_yz_mm, [[-1.0, 2.0]]);
    }
}
