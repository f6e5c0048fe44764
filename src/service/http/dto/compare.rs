use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::{Check, REACH_MM};
use prosopon_geometry::Point;
use prosopon_jobs::{RegisterOn, SurfaceSource, UNMOVED_MM};
use prosopon_planning::evaluate::{Mask, MaskRegion};
use prosopon_session::{BoxDocument, ErrorDocument, Fault};
use prosopon_store::SessionId;

/// A surface of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartName {
    /// Outer skin before the operation.
    Skin,
    /// Skull.
    Skull,
    /// Post-operative skin.
    Target,
}

impl PartName {
    fn of(self, session: SessionId) -> SurfaceSource {
        match self {
            Self::Skin => SurfaceSource::Skin(session),
            Self::Skull => SurfaceSource::Skull(session),
            Self::Target => SurfaceSource::Target(session),
        }
    }
}

/// A stored surface, named by `session` and `part` or by `job` and `step`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceRef {
    /// Id of a session; give it with `part`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<Uuid>,
    /// Surface of the session.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<PartName>,
    /// Id of a solve; give it with `step`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<Uuid>,
    /// Step number of the solve, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
}

impl SurfaceRef {
    pub(in crate::http) fn named(&self, pointer: &str) -> Result<SurfaceSource, Fault> {
        match (self.session, self.part, self.job, self.step) {
            (Some(session), Some(part), None, None) => Ok(part.of(session.into())),
            (None, None, Some(job), Some(step)) => Ok(SurfaceSource::Step(job.into(), step)),
            _ => {
                let mut check = Check::default();
                check.fault(pointer, "must have session and part, or job and step");
                check.finish()?;
                Err(Fault::invalid(Vec::new()))
            }
        }
    }
}

/// A region of space: a box (`min_mm` and `max_mm`) or a ball (`centre_mm` and `radius_mm`).
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PartRequest {
    /// Smallest coordinates of a box, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_mm: Option<[f64; 3]>,
    /// Largest coordinates of a box, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_mm: Option<[f64; 3]>,
    /// Centre of a ball, LPS mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<[f64; 3]>,
    /// Radius of a ball, mm, at least 0.1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}

impl PartRequest {
    fn part(&self, pointer: &str, check: &mut Check) -> Option<MaskRegion> {
        match (self.min_mm, self.max_mm, self.centre_mm, self.radius_mm) {
            (Some(min_mm), Some(max_mm), None, None) => {
                Some(MaskRegion::Box((&check.bounds(pointer, BoxDocument { min_mm, max_mm })).into()))
            }
            (None, None, Some(centre), Some(radius_mm)) => {
                let centre = Point::from(check.vector(&format!("{pointer}/centre_mm"), centre));
                check.number(&format!("{pointer}/radius_mm"), radius_mm, 0.1, REACH_MM);
                Some(MaskRegion::Ball { centre, radius_mm })
            }
            _ => {
                check.fault(pointer, "must have min_mm and max_mm, or centre_mm and radius_mm");
                None
            }
        }
    }
}

/// Rigid registration of the prediction onto the reference before the comparison.
///
/// The registration uses the vertices that lie in one of `unaltered` (all when empty), lie in none of `altered`, and are true
/// in `unaltered_vertices`. If none of the three is given, a job's step is registered on the skin that its plan does not move,
/// and any other surface on all vertices, of which the worst pairs are trimmed.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterRequest {
    /// Regions that the operation altered; the registration ignores them. None when absent.
    #[serde(default)]
    pub altered: Vec<PartRequest>,
    /// Regions that the registration uses; all of the prediction when absent or empty.
    #[serde(default)]
    pub unaltered: Vec<PartRequest>,
    /// For each vertex of the prediction, whether the registration uses it; all when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unaltered_vertices: Option<Vec<bool>>,
    /// Displacement below which a vertex of a step counts as unmoved, mm, 1e-6 to 100; 0.1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threshold_mm: Option<f64>,
}

/// Request for a comparison of two surfaces.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CompareRequest {
    /// Surface that was predicted.
    pub prediction: SurfaceRef,
    /// Surface with which the prediction is compared.
    pub reference: SurfaceRef,
    /// Regions to which the statistics are limited: only prediction vertices inside count. All when absent.
    #[serde(default)]
    pub mask: Vec<PartRequest>,
    /// For each vertex of the prediction, whether it counts in the statistics; all when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_vertices: Option<Vec<bool>>,
    /// Regions that neither statistics nor registration use; none when absent.
    #[serde(default)]
    pub exclude: Vec<PartRequest>,
    /// Whether statistics and registration ignore the eyes; false when absent.
    ///
    /// The landmarks of the prediction's session locate the eyes; without landmarks, the proportions of an adult's face do.
    #[serde(default)]
    pub exclude_eyes: bool,
    /// Rigid registration before the comparison; none when absent.
    #[serde(default)]
    pub register: Option<RegisterRequest>,
    /// Whether the answer includes the value of every vertex; false when absent.
    #[serde(default)]
    pub values: bool,
}

/// A checked request for a comparison.
#[derive(Debug)]
pub(in crate::http) struct CheckedCompare {
    pub(in crate::http) prediction: SurfaceSource,
    pub(in crate::http) reference: SurfaceSource,
    pub(in crate::http) mask: Mask,
    pub(in crate::http) exclude: Vec<MaskRegion>,
    pub(in crate::http) exclude_eyes: bool,
    pub(in crate::http) register: Option<RegisterOn>,
    pub(in crate::http) values: bool,
}

impl CompareRequest {
    pub(in crate::http) fn check(self) -> Result<CheckedCompare, Fault> {
        let mut check = Check::default();
        let mask =
            Mask { only: parts("/mask", &self.mask, &mut check), vertices: self.mask_vertices, except: Vec::new() };
        let exclude = parts("/exclude", &self.exclude, &mut check);
        let register = self.register.map(|r| {
            let threshold_mm = r.threshold_mm.unwrap_or(UNMOVED_MM);
            check.number("/register/threshold_mm", threshold_mm, 1e-6, 100.0);
            let region = Mask {
                only: parts("/register/unaltered", &r.unaltered, &mut check),
                except: parts("/register/altered", &r.altered, &mut check),
                vertices: r.unaltered_vertices,
            };
            RegisterOn { region, threshold_mm }
        });
        check.finish()?;
        let (prediction, reference) = (self.prediction.named("/prediction")?, self.reference.named("/reference")?);
        let exclude_eyes = self.exclude_eyes;
        Ok(CheckedCompare { prediction, reference, mask, exclude, exclude_eyes, register, values: self.values })
    }
}

fn parts(pointer: &str, requests: &[PartRequest], check: &mut Check) -> Vec<MaskRegion> {
    requests.iter().enumerate().filter_map(|(i, p)| p.part(&format!("{pointer}/{i}"), check)).collect()
}

/// A signed error map: statistics and, on request, the value of every vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CompareView {
    /// Statistics of the error.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every prediction vertex, mm; `null` for vertices that do not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values_mm: Option<Vec<Option<f32>>>,
    /// Distance of every prediction vertex from its counterpart, mm.
    ///
    /// Present if both surfaces have the same triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correspondence_mm: Option<Vec<Option<f32>>>,
}

/// A signed error map with the value of every vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorView {
    /// Statistics of the error.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every vertex of the deformed skin, mm; `null` for vertices without an error.
    pub values_mm: Vec<Option<f32>>,
    /// Distance of every vertex from its counterpart, mm.
    ///
    /// Present if the error was computed on demand against a surface with the same triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correspondence_mm: Option<Vec<Option<f32>>>,
}

/// Replaces values that are not finite by `None`, since JSON has no NaN.
pub(in crate::http) fn finite(values: Vec<f32>) -> Vec<Option<f32>> {
    values.into_iter().map(|v| v.is_finite().then_some(v)).collect()
}
