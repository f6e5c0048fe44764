use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::material::SkinElementName;
use prosopon_tissue::fem::Model;

/// Mechanical model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelName {
    /// The service chooses: `mixed` with the skin element `c1_prism`, else `nonlinear`, which is as accurate in less time.
    #[default]
    Auto,
    /// Linear finite elements: small strain on linear elements (LFEM).
    Linear,
    /// Mass-tensor model (MTM): small strain; each vertex relaxes under the forces of its neighbours.
    MassTensor,
    /// Nonlinear finite elements: hyperelastic laws on linear elements (NFEM).
    Nonlinear,
    /// Mixed elements: hyperelastic laws with a C1-continuous skin layer (NFM-EM).
    Mixed,
}

impl ModelName {
    /// The model that is solved with this element of the skin; `auto` is resolved.
    ///
    /// Jobs that an earlier version stored as `auto` have `c1_prism`: they were and stay `mixed`.
    #[must_use]
    pub fn resolved(self, skin_element: Option<SkinElementName>) -> Self {
        match (self, skin_element) {
            (Self::Auto, Some(SkinElementName::C1Prism)) => Self::Mixed,
            (Self::Auto, Some(SkinElementName::Tet | SkinElementName::Wedge) | None) => Self::Nonlinear,
            (Self::Linear | Self::MassTensor | Self::Nonlinear | Self::Mixed, _) => self,
        }
    }

    /// Name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Linear => "linear",
            Self::MassTensor => "mass_tensor",
            Self::Nonlinear => "nonlinear",
            Self::Mixed => "mixed",
        }
    }
}

impl From<ModelName> for Model {
    fn from(name: ModelName) -> Self {
        match name {
            ModelName::Linear => Self::Linear,
            ModelName::MassTensor => Self::MassTensor,
            ModelName::Auto | ModelName::Nonlinear => Self::Nonlinear,
            ModelName::Mixed => Self::Mixed,
        }
    }
}
