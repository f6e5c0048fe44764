use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::CutDocument;
use crate::MeshSettingsDocument;
use prosopon_tissue::mesh::MeshReport;

/// Report of the tissue mesh of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshDocument {
    /// Settings that the mesh was built with.
    pub settings: MeshSettingsDocument,
    /// Osteotomy whose segments determined the region.
    ///
    /// Absent when the region is the front of the face or a box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub osteotomy: Option<String>,
    /// Cuts of the osteotomy; only in the stored form.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuts: Option<Vec<CutDocument>>,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of prisms.
    pub prisms: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of inverted elements.
    pub inverted: usize,
    /// Smallest dihedral angle of a tetrahedron, degrees.
    pub min_dihedral_deg: f64,
    /// Largest dihedral angle of a tetrahedron, degrees.
    pub max_dihedral_deg: f64,
    /// Smallest scaled Jacobian of a prism, 0 to 1.
    pub min_scaled_jacobian: f64,
    /// Relative difference of the mesh's volume from that of the domain.
    pub volume_error: f64,
    /// Largest distance of a prism's outer vertex or barycentre from the skin, mm.
    pub max_skin_distance_mm: f64,
    /// Number of outer edges with more than two boundary faces.
    pub non_manifold_edges: usize,
    /// Share of muscle in the volume below the skin layer, 0 to 1; the rest is fat.
    #[serde(default)]
    pub muscle_share: f64,
    /// Whether the CT separated fat from muscle; otherwise depth did.
    #[serde(default)]
    pub tissue_from_ct: bool,
    /// What was changed to build the mesh, and where.
    pub warnings: Vec<String>,
}

impl MeshDocument {
    /// The document of a mesh without its cuts.
    #[must_use]
    pub fn new(settings: MeshSettingsDocument, osteotomy: Option<String>, r: &MeshReport) -> Self {
        Self {
            settings,
            osteotomy,
            cuts: None,
            tetrahedra: r.tetrahedra,
            prisms: r.prisms,
            nodes: r.nodes,
            inverted: r.inverted,
            min_dihedral_deg: r.min_dihedral_deg,
            max_dihedral_deg: r.max_dihedral_deg,
            min_scaled_jacobian: r.min_scaled_jacobian,
            volume_error: r.volume_error,
            max_skin_distance_mm: r.max_skin_distance_mm,
            non_manifold_edges: r.nonmanifold_edges,
            muscle_share: r.muscle_share,
            tissue_from_ct: r.tissue_from_ct,
            warnings: r.warnings.clone(),
        }
    }
}
