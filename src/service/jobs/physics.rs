use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use prosopon_session::{
    D1ReadingName, LockingName, PresetName, SkinElementName, TissueLawsDocument, UnstableMaterialName,
};
use prosopon_tissue::fem::{Model, SolveSettings};

/// Mechanical model of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SolveModel {
    /// Small strain on linear elements.
    Linear,
    /// Small strain on linear elements, solved by relaxing each vertex under the forces of its neighbours.
    MassTensor,
    /// Hyperelastic on linear elements.
    Nonlinear,
    /// Hyperelastic with a C1 skin layer.
    Mixed,
}

impl SolveModel {
    /// Name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::MassTensor => "mass_tensor",
            Self::Nonlinear => "nonlinear",
            Self::Mixed => "mixed",
        }
    }
}

impl From<SolveModel> for Model {
    fn from(model: SolveModel) -> Self {
        match model {
            SolveModel::Linear => Self::Linear,
            SolveModel::MassTensor => Self::MassTensor,
            SolveModel::Nonlinear => Self::Nonlinear,
            SolveModel::Mixed => Self::Mixed,
        }
    }
}

/// Model, elements, materials and tolerances of a solve.
///
/// Members that older records lack have the values that those jobs were solved with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhysicsRecord {
    /// Mechanical model.
    pub model: SolveModel,
    /// Whether the model was chosen by the service.
    pub model_chosen: bool,
    /// Element of the skin layer; the model's default when `None`.
    #[serde(default)]
    pub skin_element: Option<SkinElementName>,
    /// Locking-free formulation of linear tetrahedra; plain linear tetrahedra when `None`.
    #[serde(default)]
    pub locking: Option<LockingName>,
    /// Material preset.
    pub preset: PresetName,
    /// Meaning of D1 among the published constants.
    #[serde(default)]
    pub d1_reading: D1ReadingName,
    /// Material laws that replace those of the preset.
    #[serde(default)]
    pub materials: TissueLawsDocument,
    /// Residual force over reaction force below which a step is in equilibrium.
    ///
    /// The solver's default when `None`.
    #[serde(default)]
    pub relative_residual: Option<f64>,
    /// Largest penetration allowed in a converged step, mm; the solver's default when `None`.
    #[serde(default)]
    pub penetration_tolerance_mm: Option<f64>,
    /// What the solver does when a material loses ellipticity.
    #[serde(default)]
    pub unstable_material: UnstableMaterialName,
    /// Tissue that the plan moves by less than this is left out, mm; 0 keeps all tissue.
    #[serde(default)]
    pub leave_out_below_mm: f64,
}

impl PhysicsRecord {
    /// The members as a report shows them.
    #[must_use]
    pub fn parameters(&self) -> Map<String, Value> {
        let mut members = match serde_json::to_value(self) {
            Ok(Value::Object(members)) => members,
            // Not reached: a record of plain values is always an object.
            _ => Map::new(),
        };
        members.remove("model");
        let chosen = members.remove("model_chosen").unwrap_or_default();
        members.insert("model_chosen_by_the_service".to_owned(), chosen);
        members
    }
}

impl From<&PhysicsRecord> for SolveSettings {
    fn from(r: &PhysicsRecord) -> Self {
        let materials = r.materials.over(r.preset.materials(r.d1_reading));
        let mut settings = Self::new(r.model.into(), materials);
        settings.skin_element = r.skin_element.map_or(settings.skin_element, Into::into);
        settings.locking = r.locking.map_or(settings.locking, Into::into);
        settings.relative_residual = r.relative_residual.unwrap_or(settings.relative_residual);
        settings.penetration_tolerance_mm = r.penetration_tolerance_mm.unwrap_or(settings.penetration_tolerance_mm);
        settings.unstable_material = r.unstable_material.into();
        settings
    }
}
