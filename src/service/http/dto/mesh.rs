use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::PartView;
use super::check::Check;
use prosopon_session::{BoxDocument, Fault, MeshDocument, MeshSettingsDocument};
use prosopon_tissue::mesh::MeshSettings;

/// A tissue mesh to build; absent values take their defaults.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BuildMesh {
    /// Thickness of the skin layer, mm.
    #[serde(default)]
    pub skin_thickness_mm: Option<f64>,
    /// Edge of the lattice, mm.
    #[serde(default)]
    pub edge_mm: Option<f64>,
    /// Tissue deeper than this below the skin is left out, mm.
    #[serde(default)]
    pub depth_mm: Option<f64>,
    /// Box to mesh; chosen from the segments of `osteotomy`, else the front of the face.
    #[serde(default)]
    pub region: Option<BoxDocument>,
    /// Tells fat from muscle by depth alone, muscle being the 40 % next to bone, also where a CT tells.
    #[serde(default)]
    pub tissue_by_depth: bool,
    /// The osteotomy whose segments will move.
    #[serde(default)]
    pub osteotomy: Option<Uuid>,
}

impl TryFrom<&BuildMesh> for MeshSettingsDocument {
    type Error = Fault;

    fn try_from(r: &BuildMesh) -> Result<Self, Fault> {
        let d = Self::default();
        let mut check = Check::default();
        let thickness = r.skin_thickness_mm.unwrap_or(d.skin_thickness_mm);
        let skin_thickness_mm = check.number("/skin_thickness_mm", thickness, 0.1, 10.0);
        let edge_mm = check.number("/edge_mm", r.edge_mm.unwrap_or(d.edge_mm), 0.5, 20.0);
        let least = MeshSettings { skin_thickness_mm, edge_mm, ..MeshSettings::default() }.least_depth_mm();
        let settings = Self {
            skin_thickness_mm,
            edge_mm,
            depth_mm: check.number("/depth_mm", r.depth_mm.unwrap_or(d.depth_mm), least, 200.0),
            region: r.region.map(|b| check.bounds("/region", b)),
            tissue_by_depth: r.tissue_by_depth,
        };
        check.finish()?;
        Ok(settings)
    }
}

/// The tissue mesh of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshView {
    /// State and time.
    #[serde(flatten)]
    pub part: PartView,
    /// What the last build gave.
    pub report: Option<MeshDocument>,
}
