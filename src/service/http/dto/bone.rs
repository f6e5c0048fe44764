use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::{Check, REACH_MM};
use super::inputs::checked_plane;
use prosopon_geometry::{Point, TriMesh};
use prosopon_planning::plan::{BoundedPlane, Cut, CutShape, Landmarks, Protected, Template, TemplateCall};
use prosopon_session::{
    CutSurfaceDocument, Cuts, Fault, FreePartDocument, LandmarksDocument, OsteotomyDocument, PlacedPlane,
    PlaneDocument, PolylineDocument,
};
use prosopon_store::OsteotomyRecord;

/// Shortest polyline of a cut, mm; a shorter one is a mistake in units.
const SHORTEST_LINE_MM: f64 = 1.0;

/// One cut, given by exactly one of `plane`, `polyline`, `surface` and `free_part`.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CutRequest {
    /// A plane, bounded by a rectangle or unbounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<PlaneDocument>,
    /// A polyline on the bone, at least 1 mm long, with sawing direction and depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polyline: Option<PolylineDocument>,
    /// A triangle surface, open or closed, of any orientation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surface: Option<CutSurfaceDocument>,
    /// A point in a separate part of bone. Nothing is cut: that part becomes a moving segment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_part: Option<FreePartDocument>,
    /// Kerf (width of the saw cut), mm, 0 to 10; 0 when absent. Half of it is removed from each side.
    #[serde(default)]
    pub kerf_mm: Option<f64>,
}

/// Osteotomy templates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TemplateName {
    /// Le Fort I. Landmarks: `le_fort_1_plane`, `midline_x_mm`, `occlusal_plane_z_mm`.
    ///
    /// With `zygomaxillare_left` and `zygomaxillare_right`, a plane that would run through the cheek bones steps down beside
    /// the nose.
    #[serde(rename = "le_fort_1")]
    LeFort1,
    /// Le Fort II.
    ///
    /// Landmarks: `nasion`, `orbitale_left`, `orbitale_right`, `zygomaxillare_left`, `zygomaxillare_right` and
    /// `occlusal_plane_z_mm`.
    #[serde(rename = "le_fort_2")]
    LeFort2,
    /// Le Fort III.
    ///
    /// Landmarks: `nasion`, `frontomalare_left`, `frontomalare_right` and `occlusal_plane_z_mm`.
    #[serde(rename = "le_fort_3")]
    LeFort3,
    /// Sagittal split osteotomy of the left ramus (BSSO).
    ///
    /// Medial cut above the foramen, split along the oblique ridge, buccal cut at the molar.
    /// Landmarks: `lingula_left`, `molar_left` (buccal, beside the second molar), `midline_x_mm`, `occlusal_plane_z_mm`. With
    /// `condylion_left`, the cuts also separate the joint.
    BssoLeft,
    /// Sagittal split osteotomy of the right ramus: as `bsso_left`, with the landmarks of the right side.
    BssoRight,
    /// Genioplasty. Landmarks: `pogonion` and `menton`.
    Genioplasty,
    /// Two-piece maxilla: Le Fort I with a midsagittal split.
    TwoPieceMaxilla,
    /// Separates the whole mandible from the skull without an osteotomy, for autorotation.
    ///
    /// Landmarks: `condylion_left`, `condylion_right`, `menton`, `occlusal_plane_z_mm`; `lingula_left` and `lingula_right`
    /// improve the separation.
    Mandible,
}

impl From<TemplateName> for Template {
    fn from(name: TemplateName) -> Self {
        match name {
            TemplateName::LeFort1 => Self::LeFort1,
            TemplateName::LeFort2 => Self::LeFort2,
            TemplateName::LeFort3 => Self::LeFort3,
            TemplateName::BssoLeft => Self::BssoLeft,
            TemplateName::BssoRight => Self::BssoRight,
            TemplateName::Genioplasty => Self::Genioplasty,
            TemplateName::TwoPieceMaxilla => Self::TwoPieceMaxilla,
            TemplateName::Mandible => Self::Mandible,
        }
    }
}

/// A template of cuts, placed by landmarks.
///
/// Landmarks that the request lacks are taken from the session. Landmarks that the session lacks too are proposed from the
/// surfaces, with a warning.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateRequest {
    /// Name of the template.
    pub name: TemplateName,
    /// At most 100 points by name, LPS mm. They replace the session's points of the same names.
    #[serde(default)]
    pub landmarks: BTreeMap<String, [f64; 3]>,
    /// Plane of the horizontal cut of a Le Fort I; the session's `le_fort_1_plane` when absent.
    #[serde(default)]
    pub plane: Option<PlacedPlane>,
    /// x coordinate of the facial midline, LPS mm; the session's when absent.
    #[serde(default)]
    pub midline_x_mm: Option<f64>,
    /// z coordinate of the occlusal plane, LPS mm; the session's when absent.
    #[serde(default)]
    pub occlusal_plane_z_mm: Option<f64>,
    /// Kerf (width of the saw cut), mm, 0 to 10; 0 when absent. Separations have no kerf.
    #[serde(default)]
    pub kerf_mm: Option<f64>,
}

/// A protected structure, such as a nerve or a root: a point, or a polyline through several points.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ProtectedRequest {
    /// Name of the structure, 1 to 64 characters.
    pub name: String,
    /// One point, or the vertices of a polyline, LPS mm; 1 to 1000 points.
    pub points_mm: Vec<[f64; 3]>,
    /// Distance to a cut below which the answer warns, mm, 0 to 100. No warning when absent.
    #[serde(default)]
    pub margin_mm: Option<f64>,
}

/// Request for an osteotomy: `template` or `templates`, `cuts`, or both. Cuts of templates come first.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateOsteotomy {
    /// A tag of at most 200 characters that the service stores and does not interpret.
    #[serde(default)]
    pub label: Option<String>,
    /// 1 to 32 cuts; none when absent.
    #[serde(default)]
    pub cuts: Option<Vec<CutRequest>>,
    /// One template; none when absent.
    #[serde(default)]
    pub template: Option<TemplateRequest>,
    /// 1 to 8 templates, instead of `template`.
    #[serde(default)]
    pub templates: Option<Vec<TemplateRequest>>,
    /// At most 32 protected structures. The answer gives the distance of each cut to each structure.
    #[serde(default)]
    pub protected: Vec<ProtectedRequest>,
}

impl CreateOsteotomy {
    /// Checks the request and returns the label and the cuts.
    pub(in crate::http) fn check(self, landmarks: Option<&LandmarksDocument>) -> Result<(Option<String>, Cuts), Fault> {
        let mut check = Check::default();
        let label = check.label("/label", self.label);
        let session = landmarks.map(Landmarks::from).unwrap_or_default();
        if self.cuts.is_none() && self.template.is_none() && self.templates.is_none() {
            check.fault("", "the request has no cuts; give cuts, template or templates");
        }
        if self.template.is_some() && self.templates.is_some() {
            check.fault("/templates", "cannot be combined with template; give one of them");
        }
        let mut templates = Vec::new();
        if let Some(t) = &self.template {
            templates.push(template(&mut check, "/template", t, &session));
        }
        if let Some(all) = &self.templates {
            if !(1..=8).contains(&all.len()) {
                check.fault("/templates", format!("has {} templates, allowed are 1 to 8", all.len()));
            }
            let placed = all.iter().take(8).enumerate();
            templates.extend(placed.map(|(i, t)| template(&mut check, &format!("/templates/{i}"), t, &session)));
        }
        if let Some(cuts) = &self.cuts
            && !(1..=32).contains(&cuts.len())
        {
            check.fault("/cuts", format!("has {} cuts, allowed are 1 to 32", cuts.len()));
        }
        let given = self.cuts.iter().flatten().take(32).enumerate();
        let cuts: Vec<Cut> = given.filter_map(|(i, c)| cut(&mut check, &format!("/cuts/{i}"), c)).collect();
        if self.protected.len() > 32 {
            check.fault("/protected", format!("has {} members, at most 32 are allowed", self.protected.len()));
        }
        let protected = self.protected.iter().take(32).enumerate();
        let protected = protected.map(|(i, p)| kept_away(&mut check, &format!("/protected/{i}"), p)).collect();
        check.finish()?;
        Ok((label, Cuts { templates, cuts, protected }))
    }
}

fn kept_away(check: &mut Check, pointer: &str, p: &ProtectedRequest) -> Protected {
    if !(1..=64).contains(&p.name.chars().count()) {
        check.fault(format!("{pointer}/name"), "must have 1 to 64 characters");
    }
    if let Some(margin) = p.margin_mm {
        check.number(&format!("{pointer}/margin_mm"), margin, 0.0, 100.0);
    }
    let points = points(check, &format!("{pointer}/points_mm"), &p.points_mm, 1, 1000);
    Protected { name: p.name.clone(), points, margin_mm: p.margin_mm }
}

fn points(check: &mut Check, pointer: &str, given: &[[f64; 3]], least: usize, most: usize) -> Vec<Point> {
    if !(least..=most).contains(&given.len()) {
        check.fault(pointer, format!("has {} points, allowed are {least} to {most}", given.len()));
    }
    let taken = given.iter().take(most).enumerate();
    taken.map(|(i, p)| Point::from(check.vector(&format!("{pointer}/{i}"), *p))).collect()
}

/// `None` after a fault.
fn cut(check: &mut Check, pointer: &str, request: &CutRequest) -> Option<Cut> {
    let kerf_mm = request.kerf_mm.unwrap_or(0.0);
    check.number(&format!("{pointer}/kerf_mm"), kerf_mm, 0.0, 10.0);
    let shape = match (&request.plane, &request.polyline, &request.surface, &request.free_part) {
        (Some(plane), None, None, None) => CutShape::Plane(bounded_plane(check, &format!("{pointer}/plane"), plane)),
        (None, Some(line), None, None) => {
            let pointer = format!("{pointer}/polyline");
            let direction = check.direction(&format!("{pointer}/direction"), line.direction);
            let depth_mm = check.number(&format!("{pointer}/depth_mm"), line.depth_mm, 0.1, REACH_MM);
            let (least, most) = (2, 1000);
            let points = points(check, &format!("{pointer}/points_mm"), &line.points_mm, least, most);
            let length_mm: f64 = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
            if (least..=most).contains(&line.points_mm.len()) && length_mm < SHORTEST_LINE_MM {
                let detail = format!(
                    "make a line of {length_mm:.3} mm, at least {SHORTEST_LINE_MM} mm are needed; check that they are in mm"
                );
                check.fault(format!("{pointer}/points_mm"), detail);
            }
            CutShape::Polyline { points, direction, depth_mm }
        }
        (None, None, Some(surface), None) => {
            let pointer = format!("{pointer}/surface");
            let points = points(check, &format!("{pointer}/points_mm"), &surface.points_mm, 3, 100_000);
            if !(1..=100_000).contains(&surface.triangles.len()) {
                let detail = format!("has {} triangles, allowed are 1 to 100000", surface.triangles.len());
                check.fault(format!("{pointer}/triangles"), detail);
                return None;
            }
            match TriMesh::new(points, surface.triangles.clone()) {
                Ok(mesh) => CutShape::Surface(mesh),
                Err(error) => {
                    check.fault(format!("{pointer}/triangles"), error.to_string());
                    return None;
                }
            }
        }
        (None, None, None, Some(part)) => {
            CutShape::FreePart(Point::from(check.vector(&format!("{pointer}/free_part/point_mm"), part.point_mm)))
        }
        _ => {
            check.fault(pointer, "must have exactly one of plane, polyline, surface and free_part");
            return None;
        }
    };
    Some(Cut { kerf_mm, ..Cut::from(shape) })
}

fn bounded_plane(check: &mut Check, pointer: &str, plane: &PlaneDocument) -> BoundedPlane {
    let normal = check.direction(&format!("{pointer}/normal"), plane.normal);
    let bounds = plane.bounds.map(|b| {
        let direction = check.direction(&format!("{pointer}/bounds/direction"), b.direction);
        // The rectangle's sides must be perpendicular to the normal; a small deviation is projected out.
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

fn template(check: &mut Check, pointer: &str, t: &TemplateRequest, session: &Landmarks) -> TemplateCall {
    let mut landmarks = session.clone();
    if t.landmarks.len() > 100 {
        check.fault(
            format!("{pointer}/landmarks"),
            format!("has {} points, at most 100 are allowed", t.landmarks.len()),
        );
    }
    for (name, point) in t.landmarks.iter().take(100) {
        let escaped = name.replace('~', "~0").replace('/', "~1");
        let point = check.vector(&format!("{pointer}/landmarks/{escaped}"), *point);
        landmarks.points.insert(name.clone(), Point::from(point));
    }
    for (name, value) in [("midline_x_mm", t.midline_x_mm), ("occlusal_plane_z_mm", t.occlusal_plane_z_mm)] {
        if let Some(value) = value {
            check.number(&format!("{pointer}/{name}"), value, -REACH_MM, REACH_MM);
        }
    }
    landmarks.midline_x_mm = t.midline_x_mm.or(landmarks.midline_x_mm);
    landmarks.occlusal_z_mm = t.occlusal_plane_z_mm.or(landmarks.occlusal_z_mm);
    if let Some(plane) = &t.plane {
        let plane = checked_plane(check, &format!("{pointer}/plane"), plane);
        landmarks.le_fort_1_plane = Some((Point::from(plane.point_mm), plane.normal.into()));
    }
    let kerf_mm = t.kerf_mm.unwrap_or(0.0);
    check.number(&format!("{pointer}/kerf_mm"), kerf_mm, 0.0, 10.0);
    TemplateCall { template: t.name.into(), landmarks, kerf_mm }
}

/// A stored osteotomy: its cuts and the segments they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyView {
    /// Id of the osteotomy.
    pub id: Uuid,
    /// When the osteotomy was created (RFC 3339).
    pub created_at: String,
    /// Computing time of the cut, s.
    pub wall_s: f64,
    /// Whether bone or field settings have changed since the cut; if so, cut again.
    pub stale: bool,
    /// Cuts, segments and warnings.
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
    /// The session's osteotomies.
    pub osteotomies: Vec<OsteotomyView>,
}
