use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::{Check, REACH_MM};
use super::cut::{CutDocument, checked_cut, points};
use super::fault::Fault;
use super::landmarks::{LandmarksDocument, PlacedPlane, checked_plane};
use super::warning::Findings;
use prosopon_geometry::{Point, Warning};
use prosopon_planning::plan::{Clearance, Cut, Landmarks, Osteotomy, Protected, Segment, Template, TemplateCall};

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

impl From<Template> for TemplateName {
    fn from(template: Template) -> Self {
        match template {
            Template::LeFort1 => Self::LeFort1,
            Template::LeFort2 => Self::LeFort2,
            Template::LeFort3 => Self::LeFort3,
            Template::BssoLeft => Self::BssoLeft,
            Template::BssoRight => Self::BssoRight,
            Template::Genioplasty => Self::Genioplasty,
            Template::TwoPieceMaxilla => Self::TwoPieceMaxilla,
            Template::Mandible => Self::Mandible,
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
    pub cuts: Option<Vec<CutDocument>>,
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

/// Cuts of a request.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cuts {
    /// Templates; missing landmarks are proposed from the surfaces.
    pub templates: Vec<TemplateCall>,
    /// Further cuts.
    pub cuts: Vec<Cut>,
    /// Protected points and curves, whose distance to the cuts is reported.
    pub protected: Vec<Protected>,
    /// Warnings about the request.
    pub warnings: Vec<Warning>,
}

impl CreateOsteotomy {
    /// Checks the request and returns the label and the cuts.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn check(self, landmarks: Option<&LandmarksDocument>) -> Result<(Option<String>, Cuts), Fault> {
        let mut check = Check::default();
        let label = check.label("/label", self.label);
        let session = landmarks.map(Landmarks::from).unwrap_or_default();
        if self.cuts.is_none() && self.template.is_none() && self.templates.is_none() {
            check.fault("", "the request has no cuts; give cuts, template or templates");
        }
        if self.template.is_some() && self.templates.is_some() {
            check.fault("/templates", "cannot be combined with template; give one of them");
        }
        let called = self.template.iter().chain(self.templates.iter().flatten().take(8));
        let warnings = called.filter_map(landmarks_not_used).collect();
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
        let cuts: Vec<Cut> = given.filter_map(|(i, c)| checked_cut(&mut check, &format!("/cuts/{i}"), c)).collect();
        if self.protected.len() > 32 {
            check.fault("/protected", format!("has {} members, at most 32 are allowed", self.protected.len()));
        }
        let protected = self.protected.iter().take(32).enumerate();
        let protected = protected.map(|(i, p)| kept_away(&mut check, &format!("/protected/{i}"), p)).collect();
        check.finish()?;
        Ok((label, Cuts { templates, cuts, protected, warnings }))
    }
}

fn kept_away(check: &mut Check, pointer: &str, p: &ProtectedRequest) -> Protected {
    check.name(&format!("{pointer}/name"), Some(&p.name));
    if let Some(margin) = p.margin_mm {
        check.number(&format!("{pointer}/margin_mm"), margin, 0.0, 100.0);
    }
    let points = points(check, &format!("{pointer}/points_mm"), &p.points_mm, 1, 1000);
    Protected { name: p.name.clone(), points, margin_mm: p.margin_mm }
}

/// Warns of landmarks of a request that its template does not use: their names may be misspelt.
fn landmarks_not_used(t: &TemplateRequest) -> Option<Warning> {
    let template = Template::from(t.name);
    let used = |name: &str| template.needs().iter().chain(template.improved_by()).any(|used| *used == name);
    let others: Vec<String> =
        t.landmarks.keys().filter(|name| !used(name)).take(10).map(|name| name.chars().take(64).collect()).collect();
    let message = format!("{} does not use the landmarks {}", template.name(), others.join(", "));
    (!others.is_empty()).then(|| Warning::info("landmarks-not-used", message).act("Check the names."))
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

/// A segment of the cut bone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SegmentDocument {
    /// Number; 0 is the fixed skull.
    pub id: u32,
    /// Suggested name by position.
    ///
    /// `skull`, `maxilla`, `mandible_distal`, `mandible_proximal_left`, `chin` and others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Number of triangles of its surface.
    pub triangles: usize,
    /// Centroid, LPS mm.
    pub centroid_mm: [f64; 3],
    /// Indices of the cuts that bound it.
    pub bounded_by: Vec<usize>,
}

/// Distance of a cut to a protected point or curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ClearanceDocument {
    /// Index of the cut.
    pub cut: usize,
    /// Name of the protected point or curve.
    pub protected: String,
    /// Smallest distance to the side of the saw's slot, mm; 0 when the cut crosses it.
    pub distance_mm: f64,
    /// Nearest protected point, LPS mm.
    pub place_mm: [f64; 3],
    /// Requested margin, mm.
    pub margin_mm: Option<f64>,
    /// Whether the distance is smaller than the margin.
    pub below_margin: bool,
}

/// Cuts and the segments that they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyDocument {
    /// Label that the client gave it.
    pub label: Option<String>,
    /// Template that placed the cuts, when there is exactly one.
    pub template: Option<String>,
    /// Templates that placed cuts, in the order of the cuts.
    #[serde(default)]
    pub templates: Vec<String>,
    /// The cuts.
    pub cuts: Vec<CutDocument>,
    /// The segments, by id.
    pub segments: Vec<SegmentDocument>,
    /// Distance of each cut to each protected point or curve.
    #[serde(default)]
    pub clearances: Vec<ClearanceDocument>,
    /// Volume of the bone before it was cut, mm³.
    #[serde(default)]
    pub bone_mm3: f64,
    /// Volume of small fragments that were dropped, mm³.
    #[serde(default)]
    pub dropped_mm3: f64,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl OsteotomyDocument {
    /// The document of a cut bone.
    #[must_use]
    pub fn new(
        label: Option<String>,
        templates: Vec<String>,
        osteotomy: &Osteotomy,
        protected: &[Protected],
        clearances: &[Clearance],
    ) -> Self {
        let clearance = |c: &Clearance| {
            let of = protected.get(c.protected);
            let margin_mm = of.and_then(|p| p.margin_mm);
            ClearanceDocument {
                cut: c.cut,
                protected: of.map(|p| p.name.clone()).unwrap_or_default(),
                distance_mm: c.distance_mm,
                place_mm: c.place.coords.into(),
                margin_mm,
                below_margin: margin_mm.is_some_and(|m| c.distance_mm < m),
            }
        };
        let segment = |s: &Segment| SegmentDocument {
            id: s.id,
            name: s.name.clone(),
            volume_mm3: s.volume_mm3,
            area_mm2: s.area_mm2,
            triangles: s.surface.triangles().len(),
            centroid_mm: s.centroid.coords.into(),
            bounded_by: s.bounded_by.clone(),
        };
        Self {
            label,
            template: (templates.len() == 1).then(|| templates.concat()),
            templates,
            clearances: clearances.iter().map(clearance).collect(),
            cuts: osteotomy.cuts.iter().map(CutDocument::from).collect(),
            segments: osteotomy.segments.iter().map(segment).collect(),
            bone_mm3: osteotomy.bone_mm3,
            dropped_mm3: osteotomy.dropped_mm3,
            findings: osteotomy.warnings.iter().cloned().collect(),
        }
    }

    /// Names of the named segments, by number.
    #[must_use]
    pub fn segment_names(&self) -> BTreeMap<u32, String> {
        self.segments.iter().filter_map(|s| Some((s.id, s.name.clone()?))).collect()
    }
}
