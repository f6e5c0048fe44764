use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::Findings;
use prosopon_geometry::{Cell, VolumeMesh, Warning};
use prosopon_planning::simulate::ReadyMesh;
use prosopon_tissue::mesh::Attachment;

/// Description of an uploaded tissue mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TissueDocument {
    /// SHA-256 of the upload.
    pub sha256: String,
    /// Bytes of the upload.
    pub bytes: u64,
    /// Number of points.
    pub nodes: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
    /// Number of wedges.
    pub wedges: usize,
    /// Number of cells of each tissue: `skin`, `muscle`, `fat`, `mucosa`, `cartilage`.
    pub tissues: BTreeMap<String, usize>,
    /// Number of free points.
    pub free_nodes: usize,
    /// Number of points that slide on bone.
    pub sliding_nodes: usize,
    /// Number of points that glide on each segment; left out when there are none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gliding_nodes: BTreeMap<u32, usize>,
    /// Number of points tied to each segment; segment 0 is fixed.
    pub tied_nodes: BTreeMap<u32, usize>,
    /// Number of points that `fixed_mask` holds along some axes.
    pub held_nodes: usize,
    /// Number of points with a load `force_n`.
    pub loaded_nodes: usize,
    /// Number of wedges that lie below others or inside, and so cannot be C1 prisms.
    pub buried_wedges: usize,
    /// Smallest coordinates, LPS mm.
    pub min_mm: [f64; 3],
    /// Largest coordinates, LPS mm.
    pub max_mm: [f64; 3],
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl TissueDocument {
    /// The document of a mesh that was read from a file.
    #[must_use]
    pub fn new(sha256: String, bytes: u64, volume: &VolumeMesh, ready: &ReadyMesh, warnings: Vec<Warning>) -> Self {
        let mesh = &ready.mesh;
        let wedges = volume.cells.iter().filter(|c| matches!(c, Cell::Wedge(_))).count();
        let mut tissues = BTreeMap::new();
        let of_prisms = (0..mesh.prisms.len()).map(|p| mesh.tissue_of_prism(p));
        for tissue in mesh.tetrahedron_tissue.iter().copied().chain(of_prisms) {
            *tissues.entry(tissue.name().to_owned()).or_insert(0) += 1;
        }
        let (mut tied_nodes, mut gliding_nodes) = (BTreeMap::new(), BTreeMap::new());
        for attachment in &mesh.attachment {
            match attachment {
                Attachment::Tied(segment) => *tied_nodes.entry(*segment).or_insert(0) += 1,
                Attachment::Gliding(segment) => *gliding_nodes.entry(*segment).or_insert(0) += 1,
                Attachment::Free | Attachment::Sliding | Attachment::Fixed => {}
            }
        }
        let count = |wanted: Attachment| mesh.attachment.iter().filter(|a| **a == wanted).count();
        let extreme = |pick: fn(f64, f64) -> f64| {
            [0, 1, 2].map(|axis| mesh.positions.iter().map(|p| p[axis]).reduce(pick).unwrap_or_default())
        };
        let findings = warnings.into_iter().chain(ready.warnings.iter().cloned()).collect();
        Self {
            sha256,
            bytes,
            nodes: mesh.positions.len(),
            tetrahedra: mesh.tetrahedra.len(),
            wedges,
            tissues,
            free_nodes: count(Attachment::Free),
            sliding_nodes: count(Attachment::Sliding),
            gliding_nodes,
            tied_nodes,
            held_nodes: ready.boundary.held_axes.iter().filter(|bits| **bits != 0).count(),
            loaded_nodes: ready.boundary.loads_n.iter().filter(|f| f.norm() > 0.0).count(),
            buried_wedges: ready.buried_prisms(),
            min_mm: extreme(f64::min),
            max_mm: extreme(f64::max),
            findings,
        }
    }
}
