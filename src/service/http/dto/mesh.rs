use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::PartView;
use super::check::Check;
use prosopon_session::{BoxDocument, Fault, MeshDocument, MeshSettingsDocument};
use prosopon_tissue::mesh::MeshSettings;

/// Request for a tissue mesh. Absent members take their defaults.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BuildMesh {
    /// Thickness of the skin layer, mm, 0.1 to 10; 1.5 when absent.
    #[serde(default)]
    pub skin_thickness_mm: Option<f64>,
    /// Edge length of the mesh lattice, mm, 0.5 to 20; 4 when absent.
    #[serde(default)]
    pub edge_mm: Option<f64>,
    /// Depth below the skin to which tissue is meshed, mm, at most 200; 30 when absent.
    #[serde(default)]
    pub depth_mm: Option<f64>,
    /// Box to mesh, LPS mm.
    ///
    /// When absent: a box around the segments of `osteotomy`, else the front of the face.
    #[serde(default)]
    pub region: Option<BoxDocument>,
    /// Whether depth alone separates fat from muscle, even if a CT shows the tissue; false when absent.
    ///
    /// Muscle is then the 40 % of the depth next to bone.
    #[serde(default)]
    pub tissue_by_depth: bool,
    /// Id of the osteotomy whose segments will move; none when absent.
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
    /// State, size and build time.
    #[serde(flatten)]
    pub part: PartView,
    /// Quality report of the last build; `null` before the first build.
    pub report: Option<MeshDocument>,
}
