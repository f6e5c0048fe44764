use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use super::fault::Fault;
use super::material::PresetName;

/// Most load steps of a solve: the solver takes smaller ones by itself where it needs them.
pub const MAX_STEPS: u32 = 200;

/// Default settings of a session's jobs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SessionSettings {
    /// Number of steps for jobs that give none, 1 to 200; 6 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<u32>,
    /// Material preset for jobs that name none; `wang_2009_stable` when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<PresetName>,
}

/// Request for a new session.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateSession {
    /// A tag of at most 200 characters that the service stores and does not interpret.
    ///
    /// Never use a patient's name.
    #[serde(default)]
    pub label: Option<String>,
    /// Default settings of the session's jobs.
    #[serde(default)]
    pub settings: SessionSettings,
}

impl CreateSession {
    /// The request, checked.
    ///
    /// # Errors
    /// A fault that lists every value that is not allowed.
    pub fn check(self) -> Result<Self, Fault> {
        let mut check = Check::default();
        let label = check.label("/label", self.label);
        if let Some(steps) = self.settings.steps {
            check.number("/settings/steps", f64::from(steps), 1.0, f64::from(MAX_STEPS));
        }
        check.finish()?;
        Ok(Self { label, settings: self.settings })
    }
}
