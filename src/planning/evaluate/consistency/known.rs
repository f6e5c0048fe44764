//! Landmarks by name: the tissue on which they lie, and their place in an average head.

use super::tuning::{ROOM_MM, UNKNOWN_MM};
use crate::plan::measured_accuracy_mm;

/// Where a landmark lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::evaluate) enum Tissue {
    /// On the skin.
    Skin,
    /// On bone or teeth.
    Bone,
    /// Within the head, on no surface of its own.
    Inside,
}

/// What is known of a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::evaluate) struct Known {
    /// Where it lies.
    pub(in crate::evaluate) tissue: Tissue,
    /// Place in an average adult, LPS mm from the midline, the anterior nasal spine's depth and the occlusal plane.
    pub(super) reference: Option<[f64; 3]>,
    /// Largest plausible distance from its surface, mm.
    pub(in crate::evaluate) limit_mm: f64,
}

/// Points of the midline as (name, tissue, y, z), from above.
///
/// `ct_head`, the proposals on it and on `vtk_headsq`, and Farkas (Anthropometry of the Head and Face, 1994).
const MIDLINE: [(&str, Tissue, f64, f64); 27] = [
    ("glabella", Tissue::Skin, -9.0, 95.0),
    ("sella", Tissue::Inside, 68.0, 85.0),
    ("soft_nasion", Tissue::Skin, -4.0, 84.0),
    ("nasion", Tissue::Bone, 2.0, 82.0),
    ("nasal_bone_tip", Tissue::Bone, -5.0, 63.0),
    ("basion", Tissue::Bone, 90.0, 40.0),
    ("pronasale", Tissue::Skin, -27.0, 37.0),
    ("columella", Tissue::Skin, -21.0, 30.0),
    ("ans", Tissue::Bone, 0.0, 28.0),
    ("pns", Tissue::Bone, 50.0, 28.0),
    ("subnasale", Tissue::Skin, -12.0, 25.0),
    ("a_point", Tissue::Bone, 4.0, 20.0),
    ("labrale_superius", Tissue::Skin, -15.0, 10.0),
    ("stomion_superius", Tissue::Skin, -10.0, 2.0),
    ("stomion", Tissue::Skin, -10.0, 1.0),
    ("stomion_inferius", Tissue::Skin, -10.0, 0.0),
    ("incisor_lower", Tissue::Bone, 0.0, 0.0),
    ("incisor_upper", Tissue::Bone, -3.0, -2.0),
    ("labrale_inferius", Tissue::Skin, -11.0, -9.0),
    ("sublabiale", Tissue::Skin, -3.0, -20.0),
    ("b_point", Tissue::Bone, 8.0, -24.0),
    ("soft_pogonion", Tissue::Skin, 1.0, -37.0),
    ("pogonion", Tissue::Bone, 12.0, -41.0),
    ("gnathion", Tissue::Bone, 14.0, -47.0),
    ("menton", Tissue::Bone, 18.0, -50.0),
    ("soft_gnathion", Tissue::Skin, 6.0, -50.0),
    ("soft_menton", Tissue::Skin, 17.0, -57.0),
];

/// Points of the left side as (name without the side, tissue, x, y, z), from above.
const SIDES: [(&str, Tissue, [f64; 3]); 15] = [
    ("frontomalare", Tissue::Bone, [50.0, 20.0, 75.0]),
    ("exocanthion", Tissue::Skin, [46.0, 20.0, 70.0]),
    ("endocanthion", Tissue::Skin, [17.0, 8.0, 70.0]),
    ("orbitale", Tissue::Bone, [34.0, 12.0, 52.0]),
    ("tragion", Tissue::Skin, [70.0, 88.0, 48.0]),
    ("porion", Tissue::Bone, [58.0, 95.0, 50.0]),
    ("zygion", Tissue::Skin, [66.0, 55.0, 45.0]),
    ("condylion", Tissue::Bone, [50.0, 88.0, 42.0]),
    ("alare", Tissue::Skin, [18.0, -11.0, 33.0]),
    ("zygomaxillare", Tissue::Bone, [38.0, 22.0, 25.0]),
    ("lingula", Tissue::Bone, [42.0, 70.0, 3.0]),
    ("cheilion", Tissue::Skin, [27.0, 1.0, 0.0]),
    ("molar", Tissue::Bone, [33.0, 40.0, -13.0]),
    ("soft_gonion", Tissue::Skin, [58.0, 70.0, -22.0]),
    ("gonion", Tissue::Bone, [47.0, 72.0, -22.0]),
];

/// Room for points between lips, which may be open, mm.
const OPEN_LIPS_MM: f64 = 8.0;

/// What is known of the landmark `name`; `None` for other names.
pub(in crate::evaluate) fn known(name: &str) -> Option<Known> {
    let (stem, side) = match (name.strip_suffix("_left"), name.strip_suffix("_right")) {
        (Some(stem), _) => (stem, 1.0),
        (_, Some(stem)) => (stem, -1.0),
        (None, None) => (name, 0.0),
    };
    let open = if stem.starts_with("stomion") { OPEN_LIPS_MM } else { 0.0 };
    let limit_mm = ROOM_MM + open + measured_accuracy_mm(stem).unwrap_or(UNKNOWN_MM);
    let (tissue, reference) = if side == 0.0 {
        let found = MIDLINE.iter().find(|row| row.0 == stem).map(|(_, tissue, y, z)| (*tissue, Some([0.0, *y, *z])));
        // Names of other points of the skin begin like this.
        found.or_else(|| stem.starts_with("soft_").then_some((Tissue::Skin, None)))?
    } else {
        SIDES.iter().find(|row| row.0 == stem).map(|(_, tissue, [x, y, z])| (*tissue, Some([side * x, *y, *z])))?
    };
    Some(Known { tissue, reference, limit_mm })
}
