use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::{JobView, PartView};
use prosopon_contract::{Check, CtDocument, Fault, FieldDocument, FieldSettingsDocument, REACH_MM, Solid};
use prosopon_formats::import::{SeriesChoice, VolumeSettings};
use prosopon_geometry::Point;
use prosopon_jobs::ImportRequest;
use prosopon_planning::surface::CtSettings;

/// Largest rescale slope and intercept of a request; those of files are below 10000.
const MAX_RESCALE: f64 = 1e6;

/// Settings for reading a CT and for extracting surfaces from it.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct CtQuery {
    /// Isosurface level of the skin, HU, or in the volume's own units when these are others; it must be below `bone_hu`.
    ///
    /// When absent, -300 HU, or what corresponds to it between the peaks of air and soft tissue in a volume of other units.
    ///
    /// It must lie within the values of the volume; the job fails otherwise and names them.
    pub skin_hu: Option<f64>,
    /// Isosurface level of bone, in the same units; when absent, 300 HU or what corresponds to it.
    pub bone_hu: Option<f64>,
    /// Largest geometric error of surface simplification, mm, 0 to 5; 0.1 when absent.
    pub max_error_mm: Option<f64>,
    /// DICOM series to read if the upload has several.
    ///
    /// It is the SeriesInstanceUID of the series, or its number from 1 in the list that the warning gives.
    ///
    /// The largest CT series when absent. The service uses an identifier for this choice only and does not store it.
    pub series: Option<String>,
    /// Number from 1 of the stack to read if the series, or a file with four dimensions, has several.
    ///
    /// A stack is an acquisition, a time point, a phase, a reconstruction or a direction. Without this number such an upload is
    /// refused, and the refusal lists the stacks.
    pub stack: Option<u32>,
    /// Number from 1 of the volume to read if the archive has several that are not DICOM.
    ///
    /// Without this number such an upload is refused, and the refusal lists the volumes.
    pub volume: Option<u32>,
    /// HU per stored number, 0.000001 to 1000000; what the file says when absent.
    pub rescale_slope: Option<f64>,
    /// HU of the stored number zero, -1000000 to 1000000; what the file says when absent.
    pub rescale_intercept: Option<f64>,
    /// Largest step between uneven DICOM slices that is interpolated, mm, 0.1 to 20; 5 when absent.
    pub max_step_mm: Option<f64>,
}

/// An accepted CT: its import job, and what was read of it.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub struct CtAccepted {
    /// The job that extracts the surfaces.
    #[serde(flatten)]
    pub job: JobView,
    /// Size, place and values of the CT, and findings on how it was read.
    pub ct: CtDocument,
}

impl CtQuery {
    pub(in crate::http) fn check(self) -> Result<(CtSettings, VolumeSettings), Fault> {
        let default = CtSettings::default();
        let mut check = Check::default();
        // The values of the volume, which limit the levels, are known only to the job.
        for (name, level) in [("skin_hu", self.skin_hu), ("bone_hu", self.bone_hu)] {
            if level.is_some_and(|level| !level.is_finite()) {
                check.fault(name, "must be a finite number");
            }
        }
        let settings = CtSettings {
            skin_hu: self.skin_hu,
            bone_hu: self.bone_hu,
            max_error_mm: check.number("max_error_mm", self.max_error_mm.unwrap_or(default.max_error_mm), 0.0, 5.0),
        };
        let default = VolumeSettings::default();
        for (name, number) in [("stack", self.stack), ("volume", self.volume)] {
            if number == Some(0) {
                check.fault(name, "is 0, counted from 1");
            }
        }
        let reading = VolumeSettings {
            series: self.series.as_deref().map(SeriesChoice::of),
            stack: self.stack.map(|number| number as usize),
            volume: self.volume.map(|number| number as usize),
            rescale_slope: self.rescale_slope.map(|slope| check.number("rescale_slope", slope, 1e-6, MAX_RESCALE)),
            rescale_intercept: self
                .rescale_intercept
                .map(|hu| check.number("rescale_intercept", hu, -MAX_RESCALE, MAX_RESCALE)),
            max_step_mm: check.number("max_step_mm", self.max_step_mm.unwrap_or(default.max_step_mm), 0.1, 20.0),
            ..default
        };
        if self.series.is_some_and(|s| s.is_empty() || s.len() > 64) {
            check.fault("series", "must have 1 to 64 characters");
        }
        if settings.skin_hu.zip(settings.bone_hu).is_some_and(|(skin, bone)| skin >= bone) {
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

/// A form with one file, as `curl -F file=@skin.stl` sends it. Settings are query parameters, not fields.
#[derive(Debug, ToSchema)]
pub struct UploadForm {
    /// The file; any name will do for the field.
    #[schema(value_type = String, format = Binary)]
    pub file: Vec<u8>,
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
    pub solid: Solid,
}

impl SliceQuery {
    pub(in crate::http) fn check(self) -> Result<(Solid, usize, f64), Fault> {
        let mut check = Check::default();
        check.number("offset_mm", self.offset_mm, -REACH_MM, REACH_MM);
        check.finish()?;
        Ok((self.solid, self.axis as usize, self.offset_mm))
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
    pub solid: Solid,
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
        Ok((self.solid, self.points_mm.into_iter().map(Point::from).collect()))
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
