use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::{Check, REACH_MM, short_number};
use super::fault::Fault;
use super::warning::WarningDocument;
use prosopon_geometry::{Aabb, Point, Vector};
use prosopon_planning::plan::{Landmarks, Proposal};

/// A plane in a document.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacedPlane {
    /// A point of the plane, LPS mm. Requests may call it `point`, as older files do.
    #[serde(alias = "point")]
    pub point_mm: [f64; 3],
    /// Normal; unit length in answers.
    pub normal: [f64; 3],
}

impl PlacedPlane {
    /// Point and unit normal; `None` when the normal is zero.
    #[must_use]
    pub fn plane(&self) -> Option<(Point, Vector)> {
        Some((Point::from(self.point_mm), Vector::from(self.normal).try_normalize(1e-9)?))
    }
}

/// Frame and unit in which landmarks are stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum LandmarksFrame {
    /// x towards the patient's left, y backwards, z upwards, in mm.
    #[serde(rename = "LPS, mm")]
    LpsMm,
}

/// Landmarks and planes of a head, LPS mm.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LandmarksDocument {
    /// At most 500 points by name, LPS mm.
    ///
    /// Names are `ans`, `pronasale`, `pogonion`, `menton`, `soft_pogonion`, `nasal_bone_tip` and others. Requests may call the
    /// list `landmarks`, as older files do.
    #[serde(alias = "landmarks")]
    pub points: BTreeMap<String, [f64; 3]>,
    /// Frame and unit of all coordinates; LPS and mm when absent. No other is accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<LandmarksFrame>,
    /// Accuracy of the points, mm, as a note for readers; nothing depends on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy_mm: Option<f64>,
    /// x coordinate of the facial midline, LPS mm.
    #[serde(default)]
    pub midline_x_mm: Option<f64>,
    /// z coordinate of the occlusal plane, LPS mm.
    #[serde(default)]
    pub occlusal_plane_z_mm: Option<f64>,
    /// Plane of the horizontal cut of a Le Fort I osteotomy.
    #[serde(default)]
    pub le_fort_1_plane: Option<PlacedPlane>,
    /// Names of the entries that nobody has confirmed yet, as `GET …/landmarks?propose=true` lists them.
    ///
    /// An entry is the name of a point, `midline_x_mm`, `occlusal_plane_z_mm` or `le_fort_1_plane`. Empty when absent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub proposed: Vec<String>,
    /// Expected error of proposed points, mm, by name, as `GET …/landmarks?propose=true` gives it.
    ///
    /// Measured on heads with known landmarks; larger where the two sides of the head disagree. Kept for the names in `proposed`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub proposed_within_mm: BTreeMap<String, f64>,
    /// What someone should look at, in answers; absent when there is nothing. Requests may send it back; it is not stored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningDocument>,
}

impl From<&LandmarksDocument> for Landmarks {
    fn from(d: &LandmarksDocument) -> Self {
        Self {
            points: d.named_points().into_iter().collect(),
            midline_x_mm: d.midline_x_mm,
            occlusal_z_mm: d.occlusal_plane_z_mm,
            le_fort_1_plane: d.le_fort_1_plane.as_ref().and_then(PlacedPlane::plane),
        }
    }
}

impl LandmarksDocument {
    /// The landmarks, checked, with unit normals.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn checked(mut self) -> Result<Self, Fault> {
        let mut check = Check::default();
        if self.points.len() > 500 {
            check.fault("/points", format!("has {} points, at most 500 are allowed", self.points.len()));
        }
        for (name, point) in &self.points {
            let pointer = format!("/points/{}", name.replace('~', "~0").replace('/', "~1"));
            check.vector(&pointer, *point);
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            if !(1..=64).contains(&name.len()) || !name.chars().all(plain) {
                check.fault(pointer, "a name must have 1 to 64 characters from a to z, 0 to 9 and _");
            }
        }
        check_size(&mut check, self.points.values());
        for (pointer, value) in
            [("/midline_x_mm", self.midline_x_mm), ("/occlusal_plane_z_mm", self.occlusal_plane_z_mm)]
        {
            if let Some(value) = value {
                check.number(pointer, value, -REACH_MM, REACH_MM);
            }
        }
        if let Some(accuracy) = self.accuracy_mm {
            check.number("/accuracy_mm", accuracy, 0.0, REACH_MM);
        }
        for (index, name) in self.proposed.iter().take(600).enumerate() {
            let known = match name.as_str() {
                "midline_x_mm" => self.midline_x_mm.is_some(),
                "occlusal_plane_z_mm" => self.occlusal_plane_z_mm.is_some(),
                "le_fort_1_plane" => self.le_fort_1_plane.is_some(),
                point => self.points.contains_key(point),
            };
            if !known {
                check.fault(format!("/proposed/{index}"), "names no value of this request; remove it");
            }
        }
        if self.proposed.len() > 600 {
            check.fault("/proposed", format!("has {} names, at most 600 are allowed", self.proposed.len()));
        }
        if self.proposed_within_mm.values().any(|mm| !(mm.is_finite() && *mm >= 0.0)) {
            check.fault(
                "/proposed_within_mm",
                "contains a value that is negative or not finite; send the proposed values or leave them out",
            );
        }
        self.le_fort_1_plane = self.le_fort_1_plane.map(|p| checked_plane(&mut check, "/le_fort_1_plane", &p));
        check.finish()?;
        self.warnings.clear();
        let proposed = &self.proposed;
        self.proposed_within_mm.retain(|name, _| proposed.contains(name));
        Ok(self)
    }

    /// Adds proposals for landmarks that are not given.
    #[must_use]
    pub fn with_proposals(mut self, proposal: &Proposal) -> Self {
        let mut landmarks = Landmarks::from(&self);
        let filled = proposal.fill(&mut landmarks);
        let within = |name: &String| Some((name.clone(), *proposal.within_mm.get(name)?));
        self.proposed_within_mm.extend(filled.iter().filter_map(within));
        self.proposed.extend(filled);
        self.points = landmarks.points.into_iter().map(|(name, p)| (name, p.coords.into())).collect();
        self.midline_x_mm = landmarks.midline_x_mm;
        self.occlusal_plane_z_mm = landmarks.occlusal_z_mm;
        let placed = |(p, n): (Point, Vector)| PlacedPlane { point_mm: p.coords.into(), normal: n.into() };
        self.le_fort_1_plane = self.le_fort_1_plane.or(landmarks.le_fort_1_plane.map(placed));
        self
    }

    /// Names and points (LPS mm) for the numerics.
    #[must_use]
    pub fn named_points(&self) -> Vec<(String, Point)> {
        self.points.iter().map(|(name, p)| (name.clone(), Point::from(*p))).collect()
    }
}

/// Checks that the landmarks are in mm: those of a head lie centimetres apart.
///
/// Landmarks in metres would lie within one millimetre, those in micrometres metres apart. Points out of range already have a
/// fault.
fn check_size<'a>(check: &mut Check, points: impl Iterator<Item = &'a [f64; 3]>) {
    const ALLOWED_MM: [f64; 2] = [2.0, 1000.0];
    let within_reach = points.filter(|p| p.iter().all(|c| c.abs() <= REACH_MM));
    let points: Vec<Point> = within_reach.map(|p| Point::from(*p)).collect();
    let Some(bounds) = Aabb::of(&points).filter(|_| points.len() > 1) else { return };
    let size_mm = (bounds.max - bounds.min).norm();
    if !(ALLOWED_MM[0]..=ALLOWED_MM[1]).contains(&size_mm) {
        let detail = format!(
            "the points lie within {} mm of each other, allowed is {} to {} mm; check that the coordinates are in mm",
            short_number(size_mm),
            ALLOWED_MM[0],
            ALLOWED_MM[1]
        );
        check.fault("/points", detail);
    }
}

pub(super) fn checked_plane(check: &mut Check, pointer: &str, plane: &PlacedPlane) -> PlacedPlane {
    PlacedPlane {
        point_mm: check.vector(&format!("{pointer}/point_mm"), plane.point_mm),
        normal: check.direction(&format!("{pointer}/normal"), plane.normal).into(),
    }
}
