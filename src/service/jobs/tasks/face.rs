//! Where the parts of a face are, in the frame of its head.

use super::bone::frame_of;
use crate::Service;
use prosopon_contract::{Fault, LandmarksDocument};
use prosopon_geometry::{Motion, Point, TriMesh};
use prosopon_planning::evaluate::{FaceRegion, MaskRegion, eyes, face_regions};
use prosopon_session::SessionParts;
use prosopon_store::PartKind;

/// What places the parts of the face; by default the proportions of an upright skin.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaceAnchors {
    /// Landmarks, LPS mm.
    pub points: Vec<(String, Point)>,
    /// x of the midline, LPS mm; `None` when unknown.
    pub midline_x_mm: Option<f64>,
    /// Maps LPS into the frame of the head, in which the parts are boxes.
    pub into: Motion,
}

impl FaceAnchors {
    fn upright(&self, skin: &TriMesh) -> (TriMesh, Vec<(String, Point)>, Option<f64>) {
        let near = self.into.inverse() * Point::origin();
        let points = self.points.iter().map(|(name, p)| (name.clone(), self.into * p)).collect();
        let midline = self.midline_x_mm.map(|x| (self.into * Point::new(x, near.y, near.z)).x);
        (skin.moved(&self.into), points, midline)
    }

    /// The parts of the face on a skin at rest.
    #[must_use]
    pub fn regions(&self, skin: &TriMesh) -> Vec<FaceRegion> {
        let (skin, points, midline) = self.upright(skin);
        let found = face_regions(&skin, &points, midline).regions;
        found.iter().map(|region| region.moved(&self.into.inverse())).collect()
    }

    /// Balls over the eyes.
    #[must_use]
    pub fn eyes(&self, skin: &TriMesh) -> [MaskRegion; 2] {
        let (skin, points, midline) = self.upright(skin);
        eyes(&skin, &points, midline).map(|ball| ball.moved(&self.into.inverse()))
    }
}

/// What places the parts of the face of a session; without skin or skull the frame is that of LPS.
///
/// # Errors
/// [`FaultKind::Internal`](prosopon_contract::FaultKind::Internal) when a stored document cannot be read, or the numerics'.
pub async fn face_of(service: &Service, parts: &SessionParts) -> Result<FaceAnchors, Fault> {
    let landmarks = parts.landmarks()?;
    let points = landmarks.as_ref().map(LandmarksDocument::named_points).unwrap_or_default();
    let has_head = parts.get(PartKind::Skin).is_some() && parts.get(PartKind::Skull).is_some();
    let into = if has_head { frame_of(service, parts).await?.motion() } else { Motion::identity() };
    Ok(FaceAnchors { points, midline_x_mm: landmarks.and_then(|l| l.midline_x_mm), into })
}
