use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::Check;
use super::fault::Fault;
use super::region::RegionRequest;
use prosopon_planning::evaluate::{Mask, MaskRegion};
use prosopon_store::{JobId, SessionId};

/// A surface of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SessionSurface {
    /// Outer skin before the operation.
    Skin,
    /// Skull.
    Skull,
    /// Post-operative skin.
    Target,
}

impl SessionSurface {
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
    pub part: Option<SessionSurface>,
    /// Id of a solve; give it with `step`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<Uuid>,
    /// Step number of the solve, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
}

impl SurfaceRef {
    pub(super) fn named(&self, pointer: &str) -> Result<SurfaceSource, Fault> {
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

/// A stored surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurfaceSource {
    /// Outer skin of a session.
    Skin(SessionId),
    /// Bone of a session.
    Skull(SessionId),
    /// Post-operative skin of a session.
    Target(SessionId),
    /// Skin of a solve at a step: job and step number.
    Step(JobId, u32),
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
    pub altered: Vec<RegionRequest>,
    /// Regions that the registration uses; all of the prediction when absent or empty.
    #[serde(default)]
    pub unaltered: Vec<RegionRequest>,
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
    pub mask: Vec<RegionRequest>,
    /// For each vertex of the prediction, whether it counts in the statistics; all when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_vertices: Option<Vec<bool>>,
    /// Regions that neither statistics nor registration use; none when absent.
    #[serde(default)]
    pub exclude: Vec<RegionRequest>,
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

/// Vertices of the prediction that a registration uses.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisterOn {
    /// Given vertices.
    ///
    /// When empty, the vertices that the plan does not move, or all when the movement is unknown.
    pub region: Mask,
    /// Vertices that the plan moves by less than this count as unmoved, mm.
    pub threshold_mm: f64,
}

/// Default of [`RegisterOn::threshold_mm`], mm.
pub const UNMOVED_MM: f64 = 0.1;

impl Default for RegisterOn {
    fn default() -> Self {
        Self { region: Mask::default(), threshold_mm: UNMOVED_MM }
    }
}

/// A checked request for a comparison.
#[derive(Debug)]
pub struct CheckedCompare {
    /// Surface that was predicted.
    pub prediction: SurfaceSource,
    /// Surface with which the prediction is compared.
    pub reference: SurfaceSource,
    /// Vertices of the prediction that count.
    pub mask: Mask,
    /// Parts of space that neither statistics nor registration use.
    pub exclude: Vec<MaskRegion>,
    /// Registration before the comparison.
    pub register: Option<RegisterOn>,
}

impl CompareRequest {
    /// Checks the request, which is also the stored form.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn checked(&self) -> Result<CheckedCompare, Fault> {
        let mut check = Check::default();
        let mask = Mask {
            only: parts("/mask", &self.mask, &mut check),
            vertices: self.mask_vertices.clone(),
            except: Vec::new(),
        };
        let exclude = parts("/exclude", &self.exclude, &mut check);
        let register = self.register.as_ref().map(|r| {
            let threshold_mm = r.threshold_mm.unwrap_or(UNMOVED_MM);
            check.number("/register/threshold_mm", threshold_mm, 1e-6, 100.0);
            let region = Mask {
                only: parts("/register/unaltered", &r.unaltered, &mut check),
                except: parts("/register/altered", &r.altered, &mut check),
                vertices: r.unaltered_vertices.clone(),
            };
            RegisterOn { region, threshold_mm }
        });
        check.finish()?;
        let (prediction, reference) = (self.prediction.named("/prediction")?, self.reference.named("/reference")?);
        Ok(CheckedCompare { prediction, reference, mask, exclude, register })
    }
}

fn parts(pointer: &str, requests: &[RegionRequest], check: &mut Check) -> Vec<MaskRegion> {
    requests.iter().enumerate().filter_map(|(i, p)| p.part(&format!("{pointer}/{i}"), check)).collect()
}
