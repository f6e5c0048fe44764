use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::{Check, REACH_MM};
use super::inputs::checked_plane;
use crate::geometry::Point;
use crate::plan::BoundedPlane;
use crate::session::{Cuts, Fault, FaultKind, LandmarksDocument, OsteotomyDocument, PlacedPlane, PlaneDocument};
use crate::store::OsteotomyRecord;

/// One cut: exactly one member.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CutRequest {
    /// A plane, bounded or endless.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<PlaneDocument>,
    /// Not in this version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polyline: Option<serde_json::Value>,
    /// Not in this version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<serde_json::Value>,
}

/// Osteotomy templates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TemplateName {
    /// Le Fort I.
    #[serde(rename = "le_fort_1")]
    LeFort1,
    /// Not in this version.
    #[serde(rename = "le_fort_2")]
    LeFort2,
    /// Not in this version.
    #[serde(rename = "le_fort_3")]
    LeFort3,
    /// Not in this version.
    BssoLeft,
    /// Not in this version.
    BssoRight,
    /// Not in this version.
    Genioplasty,
}

/// A template with its landmarks; those that are absent are taken from the session's, else proposed from the skin.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateRequest {
    /// Which template.
    pub name: TemplateName,
    /// The horizontal cut.
    #[serde(default)]
    pub plane: Option<PlacedPlane>,
    /// x of the midline.
    #[serde(default)]
    pub midline_x_mm: Option<f64>,
    /// z of the occlusal plane.
    #[serde(default)]
    pub occlusal_plane_z_mm: Option<f64>,
}

/// Cuts to make: `cuts` or `template`, not both.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateOsteotomy {
    /// An opaque tag.
    #[serde(default)]
    pub label: Option<String>,
    /// Cuts, at most 32.
    #[serde(default)]
    pub cuts: Option<Vec<CutRequest>>,
    /// A template.
    #[serde(default)]
    pub template: Option<TemplateRequest>,
}

impl CreateOsteotomy {
    /// Label and cuts.
    pub(in crate::http) fn check(self, landmarks: Option<&LandmarksDocument>) -> Result<(Option<String>, Cuts), Fault> {
        let mut check = Check::default();
        let label = check.label("/label", self.label);
        let cuts = match (self.cuts, self.template) {
            (Some(cuts), None) => planes(&mut check, &cuts)?,
            (None, Some(template)) => le_fort_1(&mut check, &template, landmarks)?,
            (Some(_), Some(_)) | (None, None) => {
                check.fault("", "exactly one of cuts and template must be given");
                Cuts::Planes(Vec::new())
            }
        };
        check.finish()?;
        Ok((label, cuts))
    }
}

fn planes(check: &mut Check, cuts: &[CutRequest]) -> Result<Cuts, Fault> {
    if !(1..=32).contains(&cuts.len()) {
        check.fault("/cuts", format!("has {} cuts, allowed are 1 to 32", cuts.len()));
    }
    let mut planes = Vec::new();
    for (index, cut) in cuts.iter().enumerate() {
        if cut.polyline.is_some() || cut.surface.is_some() {
            let detail = "cuts by polyline and surface are not available in this version";
            return Err(Fault::new(FaultKind::NotAvailable, detail).at(&format!("/cuts/{index}")));
        }
        match &cut.plane {
            Some(plane) => planes.push(bounded_plane(check, &format!("/cuts/{index}/plane"), plane)),
            None => check.fault(format!("/cuts/{index}"), "must have a plane"),
        }
    }
    Ok(Cuts::Planes(planes))
}

fn bounded_plane(check: &mut Check, pointer: &str, plane: &PlaneDocument) -> BoundedPlane {
    let normal = check.direction(&format!("{pointer}/normal"), plane.normal);
    let bounds = plane.bounds.map(|b| {
        let direction = check.direction(&format!("{pointer}/bounds/direction"), b.direction);
        // The rectangle's sides must be at right angles with the normal; a small slant is taken out.
        let in_plane = direction - normal * normal.dot(&direction);
        if in_plane.norm() < 0.9 {
            check.fault(format!("{pointer}/bounds/direction"), "does not lie in the plane");
        }
        let length = check.number(&format!("{pointer}/bounds/half_length_mm"), b.half_length_mm, 0.1, REACH_MM);
        let width = check.number(&format!("{pointer}/bounds/half_width_mm"), b.half_width_mm, 0.1, REACH_MM);
        (in_plane.try_normalize(1e-9).unwrap_or(direction), length, width)
    });
    BoundedPlane { point: Point::from(check.vector(&format!("{pointer}/point_mm"), plane.point_mm)), normal, bounds }
}

fn le_fort_1(check: &mut Check, t: &TemplateRequest, landmarks: Option<&LandmarksDocument>) -> Result<Cuts, Fault> {
    if t.name != TemplateName::LeFort1 {
        let detail = "the only template in this version is le_fort_1";
        return Err(Fault::new(FaultKind::NotAvailable, detail).at("/template/name"));
    }
    let plane = t.plane.or(landmarks.and_then(|l| l.le_fort_1_plane));
    let midline = t.midline_x_mm.or(landmarks.and_then(|l| l.midline_x_mm));
    let occlusal = t.occlusal_plane_z_mm.or(landmarks.and_then(|l| l.occlusal_plane_z_mm));
    for (pointer, value) in [("/template/midline_x_mm", midline), ("/template/occlusal_plane_z_mm", occlusal)] {
        if let Some(value) = value {
            check.number(pointer, value, -REACH_MM, REACH_MM);
        }
    }
    let plane = plane.map(|plane| {
        let plane = checked_plane(check, "/template/plane", &plane);
        (Point::from(plane.point_mm), plane.normal.into())
    });
    Ok(Cuts::LeFort1 { plane, midline_x_mm: midline, occlusal_z_mm: occlusal })
}

/// An osteotomy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyView {
    /// Its id.
    pub id: Uuid,
    /// When it was made.
    pub created_at: String,
    /// Time that the cut took, s.
    pub wall_s: f64,
    /// Whether it was cut from bone or settings that have changed.
    pub stale: bool,
    /// Cuts and segments.
    #[serde(flatten)]
    pub content: OsteotomyDocument,
}

impl OsteotomyView {
    pub(in crate::http) fn new(record: &OsteotomyRecord, content: OsteotomyDocument, field_key: Option<&str>) -> Self {
        Self {
            id: record.id.uuid(),
            created_at: record.created_at.clone(),
            wall_s: record.wall_s,
            stale: field_key != Some(record.field_key.as_str()),
            content,
        }
    }
}

/// All osteotomies of a session, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyList {
    /// The osteotomies.
    pub osteotomies: Vec<OsteotomyView>,
}
