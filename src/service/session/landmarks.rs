use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_geometry::{Point, Vector};
use prosopon_planning::plan::{Landmarks, Proposal};

/// A plane in a document.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacedPlane {
    /// A point of the plane, LPS mm.
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

/// Landmarks and planes of a head, LPS mm.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LandmarksDocument {
    /// Points by name, LPS mm.
    ///
    /// `ans`, `pronasale`, `pogonion`, `menton`, `soft_pogonion`, `nasal_bone_tip` and others.
    pub points: BTreeMap<String, [f64; 3]>,
    /// x of the midline, mm.
    pub midline_x_mm: Option<f64>,
    /// z of the occlusal plane, mm.
    pub occlusal_plane_z_mm: Option<f64>,
    /// Plane of the horizontal cut of a Le Fort I osteotomy.
    pub le_fort_1_plane: Option<PlacedPlane>,
    /// Names of proposals that no person has confirmed.
    ///
    /// Names of points, `midline_x_mm`, `occlusal_plane_z_mm` and `le_fort_1_plane`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub proposed: Vec<String>,
    /// Expected error of proposed points, mm, by name.
    ///
    /// Measured on heads with known landmarks; larger where the two sides of the head disagree.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub proposed_within_mm: BTreeMap<String, f64>,
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
