use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::PartView;
use super::check::{Check, REACH_MM};
use crate::http::extract::short_number;
use prosopon_formats::import::{SeriesChoice, VolumeSettings};
use prosopon_geometry::{Aabb, Point};
use prosopon_jobs::ImportRequest;
use prosopon_planning::surface::{BONE_LEVELS_HU, CtSettings, SKIN_LEVELS_HU};
use prosopon_session::{
    Fault, FieldDocument, FieldMethod, FieldSettingsDocument, LandmarksDocument, PlacedPlane, Solid,
};

/// Settings for extracting surfaces from a CT.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CtQuery {
    /// Isosurface level of the skin, HU; it must be below `bone_hu`. -300 when absent.
    pub skin_hu: Option<f64>,
    /// Isosurface level of bone, HU; 300 when absent.
    pub bone_hu: Option<f64>,
    /// Largest geometric error of surface simplification, mm, 0 to 5; 0.1 when absent.
    pub max_error_mm: Option<f64>,
    /// DICOM series to read if the upload has several.
    ///
    /// It is the SeriesInstanceUID of the series, or its number from 1 in the list that the warning gives.
    ///
    /// The largest CT series when absent. The service uses an identifier for this choice only and does not store it.
    pub series: Option<String>,
    /// Largest step between uneven DICOM slices that is interpolated, mm, 0.1 to 20; 5 when absent.
    pub max_step_mm: Option<f64>,
}

impl CtQuery {
    pub(in crate::http) fn check(self) -> Result<(CtSettings, VolumeSettings), Fault> {
        let default = CtSettings::default();
        let mut check = Check::default();
        let ([s0, s1], [b0, b1]) = (SKIN_LEVELS_HU, BONE_LEVELS_HU);
        let settings = CtSettings {
            skin_hu: check.number("skin_hu", self.skin_hu.unwrap_or(default.skin_hu), s0, s1),
            bone_hu: check.number("bone_hu", self.bone_hu.unwrap_or(default.bone_hu), b0, b1),
            max_error_mm: check.number("max_error_mm", self.max_error_mm.unwrap_or(default.max_error_mm), 0.0, 5.0),
        };
        let default = VolumeSettings::default();
        let reading = VolumeSettings {
            series: self.series.as_deref().map(SeriesChoice::of),
            max_step_mm: check.number("max_step_mm", self.max_step_mm.unwrap_or(default.max_step_mm), 0.1, 20.0),
            ..default
        };
        if self.series.is_some_and(|s| s.is_empty() || s.len() > 64) {
            check.fault("series", "must have 1 to 64 characters");
        }
        if settings.skin_hu >= settings.bone_hu {
            check.fault("skin_hu", "must be below bone_hu");
        }
        check.finish()?;
        Ok((settings, reading))
    }
}

pub(in crate::http) fn import_request(settings: &CtSettings, ct_sha256: String) -> ImportRequest {
    ImportRequest {
        ct_sha256,
        skin_hu: settings.skin_hu,
        bone_hu: settings.bone_hu,
        max_error_mm: settings.max_error_mm,
    }
}

/// Landmarks and planes, LPS mm. They replace all landmarks stored before.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PutLandmarks {
    /// At most 500 points by name, LPS mm.
    ///
    /// Names are `ans`, `pronasale`, `pogonion`, `menton`, `soft_pogonion`, `nasal_bone_tip` and others.
    pub points: BTreeMap<String, [f64; 3]>,
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
    /// Expected accuracy of proposed points, mm, by name, as `GET …/landmarks?propose=true` gives it.
    ///
    /// The service keeps it for the names in `proposed` and drops the others.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub proposed_within_mm: BTreeMap<String, f64>,
}

/// Options for reading landmarks.
#[derive(Debug, Clone, Copy, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LandmarksQuery {
    /// Whether the answer adds proposals for landmarks that are not stored; false when absent.
    ///
    /// The service computes the proposals from skin and skull, names them in `proposed` and does not store them.
    #[serde(default)]
    pub propose: bool,
}

impl TryFrom<PutLandmarks> for LandmarksDocument {
    type Error = Fault;

    fn try_from(request: PutLandmarks) -> Result<Self, Fault> {
        let mut check = Check::default();
        if request.points.len() > 500 {
            check.fault("/points", format!("has {} points, at most 500 are allowed", request.points.len()));
        }
        for (name, point) in &request.points {
            let pointer = format!("/points/{}", name.replace('~', "~0").replace('/', "~1"));
            check.vector(&pointer, *point);
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            if !(1..=64).contains(&name.len()) || !name.chars().all(plain) {
                check.fault(pointer, "a name must have 1 to 64 characters from a to z, 0 to 9 and _");
            }
        }
        check_size(&mut check, request.points.values());
        for (pointer, value) in
            [("/midline_x_mm", request.midline_x_mm), ("/occlusal_plane_z_mm", request.occlusal_plane_z_mm)]
        {
            if let Some(value) = value {
                check.number(pointer, value, -REACH_MM, REACH_MM);
            }
        }
        for (index, name) in request.proposed.iter().take(600).enumerate() {
            let known = match name.as_str() {
                "midline_x_mm" => request.midline_x_mm.is_some(),
                "occlusal_plane_z_mm" => request.occlusal_plane_z_mm.is_some(),
                "le_fort_1_plane" => request.le_fort_1_plane.is_some(),
                point => request.points.contains_key(point),
            };
            if !known {
                check.fault(format!("/proposed/{index}"), "names no value of this request; remove it");
            }
        }
        if request.proposed.len() > 600 {
            check.fault("/proposed", format!("has {} names, at most 600 are allowed", request.proposed.len()));
        }
        if request.proposed_within_mm.values().any(|mm| !(mm.is_finite() && *mm >= 0.0)) {
            check.fault(
                "/proposed_within_mm",
                "contains a value that is negative or not finite; send the proposed values or leave them out",
            );
        }
        let within = request.proposed_within_mm.into_iter().filter(|(name, _)| request.proposed.contains(name));
        let proposed_within_mm = within.collect();
        let le_fort_1_plane = request.le_fort_1_plane.map(|p| checked_plane(&mut check, "/le_fort_1_plane", &p));
        check.finish()?;
        Ok(Self {
            points: request.points,
            midline_x_mm: request.midline_x_mm,
            occlusal_plane_z_mm: request.occlusal_plane_z_mm,
            le_fort_1_plane,
            proposed: request.proposed,
            proposed_within_mm,
        })
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

/// Settings of the distance fields. Absent members take their defaults.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PutFieldSettings {
    /// Method of building the field; `adaptive` when absent.
    #[serde(default)]
    pub method: FieldMethod,
    /// Finest grid spacing, mm, 0.1 to 10; 0.8 when absent.
    #[serde(default)]
    pub spacing_mm: Option<f64>,
    /// Number of finest cells along the edge of the cube around each surface, 8 to 1024.
    ///
    /// It replaces `spacing_mm` when given.
    #[serde(default)]
    pub resolution: Option<u32>,
    /// Tolerance of the methods `hybrid` and `frisken`, mm, 1e-5 to 5; 1e-5 of the cube's edge when absent.
    #[serde(default)]
    pub tolerance_mm: Option<f64>,
    /// Half-width of the band around the surface that has full accuracy, mm, 0.5 to 100; 5 when absent.
    #[serde(default)]
    pub band_mm: Option<f64>,
    /// Distance that the grid extends beyond the surface, mm, 0 to 200; 10 when absent.
    #[serde(default)]
    pub margin_mm: Option<f64>,
    /// Grid spacing of the bone envelope, mm, 0.2 to 10; 1 when absent.
    #[serde(default)]
    pub envelope_spacing_mm: Option<f64>,
    /// Closing radius of the bone envelope, mm: openings narrower than twice this radius are closed.
    ///
    /// At least twice `envelope_spacing_mm`, at most 20; 2 when absent.
    #[serde(default)]
    pub envelope_closing_mm: Option<f64>,
}

impl TryFrom<PutFieldSettings> for FieldSettingsDocument {
    type Error = Fault;

    fn try_from(r: PutFieldSettings) -> Result<Self, Fault> {
        let d = Self::default();
        let mut check = Check::default();
        let mut number = |name: &str, value: Option<f64>, default, min, max| {
            check.number(&format!("/{name}"), value.unwrap_or(default), min, max)
        };
        let envelope_spacing_mm =
            number("envelope_spacing_mm", r.envelope_spacing_mm, d.envelope_spacing_mm, 0.2, 10.0);
        // A closing radius below the grid's resolution would leave holes in the envelope.
        let least = 2.0 * envelope_spacing_mm;
        let settings = Self {
            method: r.method,
            spacing_mm: number("spacing_mm", r.spacing_mm, d.spacing_mm, 0.1, 10.0),
            resolution: r.resolution.map(|n| number("resolution", Some(f64::from(n)), 0.0, 8.0, 1024.0) as u32),
            tolerance_mm: r.tolerance_mm.map(|t| number("tolerance_mm", Some(t), 0.0, 1e-5, 5.0)),
            band_mm: number("band_mm", r.band_mm, d.band_mm, 0.5, 100.0),
            margin_mm: number("margin_mm", r.margin_mm, d.margin_mm, 0.0, 200.0),
            envelope_spacing_mm,
            envelope_closing_mm: number(
                "envelope_closing_mm",
                r.envelope_closing_mm,
                d.envelope_closing_mm,
                least,
                20.0,
            ),
        };
        check.finish()?;
        Ok(settings)
    }
}

/// The distance fields of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FieldView {
    /// State, size and build time.
    #[serde(flatten)]
    pub part: PartView,
    /// Settings that the next build uses.
    pub settings: FieldSettingsDocument,
    /// Report of the last build; `null` before the first build.
    pub report: Option<FieldDocument>,
}

/// A solid with a distance field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SolidName {
    /// The volume enclosed by the skin.
    #[default]
    Skin,
    /// The outer envelope of bone.
    Bone,
}

impl From<SolidName> for Solid {
    fn from(name: SolidName) -> Self {
        match name {
            SolidName::Skin => Self::Skin,
            SolidName::Bone => Self::Bone,
        }
    }
}

/// Axis normal to a slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SliceAxis {
    /// Sagittal slice, normal to x.
    X,
    /// Coronal slice, normal to y.
    Y,
    /// Axial slice, normal to z.
    Z,
}

/// Which slice to draw.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SliceQuery {
    /// Axis normal to the slice.
    pub axis: SliceAxis,
    /// Position of the slice along the axis, LPS mm.
    pub offset_mm: f64,
    /// Solid whose field is evaluated; `skin` when absent.
    #[serde(default)]
    pub solid: SolidName,
}

impl SliceQuery {
    pub(in crate::http) fn check(self) -> Result<(Solid, usize, f64), Fault> {
        let mut check = Check::default();
        check.number("offset_mm", self.offset_mm, -REACH_MM, REACH_MM);
        check.finish()?;
        Ok((self.solid.into(), self.axis as usize, self.offset_mm))
    }
}

/// Points at which to evaluate a distance field.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointQuery {
    /// At most 100 000 points, LPS mm.
    pub points_mm: Vec<[f64; 3]>,
    /// Solid whose field is evaluated; `skin` when absent.
    #[serde(default)]
    pub solid: SolidName,
}

impl PointQuery {
    pub(in crate::http) fn check(self) -> Result<(Solid, Vec<Point>), Fault> {
        let mut check = Check::default();
        if self.points_mm.len() > 100_000 {
            check.fault("/points_mm", format!("has {} points, at most 100000 are allowed", self.points_mm.len()));
            check.finish()?;
            return Err(Fault::invalid(Vec::new()));
        }
        for (index, point) in self.points_mm.iter().enumerate() {
            check.vector(&format!("/points_mm/{index}"), *point);
        }
        check.finish()?;
        Ok((self.solid.into(), self.points_mm.into_iter().map(Point::from).collect()))
    }
}

/// Signed distances, gradients and closest points, in the order of the request's points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PointValues {
    /// Signed distances, mm; negative inside the solid.
    pub distances_mm: Vec<f64>,
    /// Gradients of the signed distance, dimensionless.
    pub gradients: Vec<[f64; 3]>,
    /// Closest points on the surface (the skin, or the outer envelope of bone), LPS mm.
    pub closest_points_mm: Vec<[f64; 3]>,
    /// Numbers of the surface triangles on which the closest points lie, from 0.
    pub triangles: Vec<usize>,
}
