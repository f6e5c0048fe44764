use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::Check;
use crate::session::{BoxDocument, ErrorDocument, Fault};
use crate::store::PartKind;

/// A surface of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartName {
    /// Outer skin.
    Skin,
    /// Bone.
    Skull,
    /// Post-operative skin.
    Target,
}

impl From<PartName> for PartKind {
    fn from(name: PartName) -> Self {
        match name {
            PartName::Skin => Self::Skin,
            PartName::Skull => Self::Skull,
            PartName::Target => Self::Target,
        }
    }
}

/// A stored surface: `session` and `part`, or `job` and `step`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfaceRef {
    /// A session …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<Uuid>,
    /// … and its part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<PartName>,
    /// A job …
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub job: Option<Uuid>,
    /// … and its step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
}

/// What a surface reference names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) enum Named {
    Part(Uuid, PartKind),
    Step(Uuid, u32),
}

impl SurfaceRef {
    pub(in crate::http) fn named(&self, pointer: &str) -> Result<Named, Fault> {
        match (self.session, self.part, self.job, self.step) {
            (Some(session), Some(part), None, None) => Ok(Named::Part(session, part.into())),
            (None, None, Some(job), Some(step)) => Ok(Named::Step(job, step)),
            _ => {
                let mut check = Check::default();
                check.fault(pointer, "must have session and part, or job and step");
                check.finish()?;
                Err(Fault::invalid(Vec::new()))
            }
        }
    }
}

/// Rigid registration of the prediction onto the reference before comparing.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterRequest {
    /// Boxes that the registration must not go by: what the operation altered.
    #[serde(default)]
    pub altered: Vec<BoxDocument>,
}

/// Two surfaces to compare.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CompareRequest {
    /// What was predicted.
    pub prediction: SurfaceRef,
    /// What it is compared with.
    pub reference: SurfaceRef,
    /// Only prediction vertices in one of these boxes count; all when absent.
    #[serde(default)]
    pub mask: Vec<BoxDocument>,
    /// Registration; none when absent.
    #[serde(default)]
    pub register: Option<RegisterRequest>,
    /// Whether the value of every vertex is sent too.
    #[serde(default)]
    pub values: bool,
}

impl CompareRequest {
    pub(in crate::http) fn check(&self) -> Result<(Named, Named), Fault> {
        let mut check = Check::default();
        for (index, b) in self.mask.iter().enumerate() {
            check.bounds(&format!("/mask/{index}"), *b);
        }
        for (index, b) in self.register.iter().flat_map(|r| &r.altered).enumerate() {
            check.bounds(&format!("/register/altered/{index}"), *b);
        }
        check.finish()?;
        Ok((self.prediction.named("/prediction")?, self.reference.named("/reference")?))
    }
}

/// A signed error map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CompareView {
    /// Statistics.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every prediction vertex, mm; `null` where it does not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values_mm: Option<Vec<Option<f32>>>,
}

/// A signed error map with the value of every vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ErrorView {
    /// Statistics.
    #[serde(flatten)]
    pub content: ErrorDocument,
    /// Signed error of every vertex of the deformed skin, mm; `null` where it has none.
    pub values_mm: Vec<Option<f32>>,
}

impl ErrorView {
    pub(in crate::http) fn new(content: ErrorDocument, values: Vec<f32>) -> Self {
        Self { content, values_mm: finite(values) }
    }
}

/// JSON has no NaN.
pub(in crate::http) fn finite(values: Vec<f32>) -> Vec<Option<f32>> {
    values.into_iter().map(|v| v.is_finite().then_some(v)).collect()
}
