use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::warning::{Findings, WarningDocument};
use prosopon_geometry::SurfaceReport;

/// Where a surface comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OriginKind {
    /// A file with the surface.
    Upload,
    /// The session's CT.
    Ct,
}

/// Origin of a stored surface.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SurfaceOrigin {
    /// Where the surface comes from.
    pub kind: OriginKind,
    /// Format of the upload: `stl`, `ply`, `obj`, `nifti`.
    pub format: String,
    /// Bytes of the upload.
    pub bytes: u64,
    /// SHA-256 of the upload.
    pub sha256: String,
}

/// Description of a stored surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurfaceDocument {
    /// Origin of the surface.
    pub origin: SurfaceOrigin,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Whether every edge has two triangles that run along it in opposite directions.
    pub closed: bool,
    /// Number of edges with one triangle.
    pub open_edges: usize,
    /// Number of holes: connected open edges count as one hole.
    pub holes: usize,
    /// Number of edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Number of edges whose two triangles run along them in the same direction.
    pub inconsistent_edges: usize,
    /// Number of connected components.
    pub components: usize,
    /// Number of triangles without area.
    pub degenerate_triangles: usize,
    /// Number of triangles that occur more than once.
    pub duplicate_triangles: usize,
    /// Number of triangles that cross or touch another one; absent when there are too many to count.
    pub self_intersections: Option<usize>,
    /// Smallest coordinates, LPS mm.
    pub min_mm: [f64; 3],
    /// Largest coordinates, LPS mm.
    pub max_mm: [f64; 3],
    /// Area, mm².
    pub area_mm2: f64,
    /// Enclosed volume, mm³; absent when the surface is not closed.
    pub volume_mm3: Option<f64>,
    /// Warnings and notes.
    #[serde(flatten)]
    pub findings: Findings,
}

impl SurfaceDocument {
    /// The document of a measured surface.
    #[must_use]
    pub fn new(
        origin: SurfaceOrigin,
        r: &SurfaceReport,
        warnings: impl IntoIterator<Item: Into<WarningDocument>>,
    ) -> Self {
        Self {
            origin,
            vertices: r.vertices,
            triangles: r.triangles,
            closed: r.closed,
            open_edges: r.boundary_edges,
            holes: r.boundary_loops,
            non_manifold_edges: r.nonmanifold_edges,
            inconsistent_edges: r.inconsistent_edges,
            components: r.components,
            degenerate_triangles: r.degenerate_triangles,
            duplicate_triangles: r.duplicate_triangles,
            self_intersections: r.self_intersecting_triangles,
            min_mm: r.bounds.min.coords.into(),
            max_mm: r.bounds.max.coords.into(),
            area_mm2: r.area_mm2,
            volume_mm3: r.closed.then_some(r.volume_mm3),
            findings: warnings.into_iter().collect(),
        }
    }
}
