use crate::geometry::{TriMesh, surface_report};
use crate::session::{Fault, SurfaceDocument, SurfaceOrigin};
use crate::store::{PartKind, PartRecord, SessionId, Store, encode_mesh, now_rfc3339};

/// A surface measured and encoded, ready to be stored. Measuring computes: make it on the CPU pool.
#[derive(Debug)]
pub struct PreparedSurface {
    document: SurfaceDocument,
    bytes: Vec<u8>,
}

impl PreparedSurface {
    /// Measures `mesh`.
    #[must_use]
    pub fn new(mesh: &TriMesh, origin: SurfaceOrigin, warnings: Vec<String>) -> Self {
        let document = SurfaceDocument::new(origin, &surface_report(mesh), warnings);
        Self { document, bytes: encode_mesh(mesh) }
    }
}

/// Stores the surface's file and returns the row that will name it, with its document.
///
/// # Errors
/// The store's.
pub async fn surface_part(
    store: &Store,
    session: SessionId,
    kind: PartKind,
    surface: PreparedSurface,
    wall_s: f64,
) -> Result<(PartRecord, SurfaceDocument), Fault> {
    let document = serde_json::to_string(&surface.document).unwrap_or_default();
    let blob = store.blobs().put(session, surface.bytes).await?;
    let part = PartRecord {
        kind,
        key: blob.sha256,
        blob: Some(blob.key),
        bytes: blob.bytes,
        wall_s,
        document,
        updated_at: now_rfc3339(),
    };
    Ok((part, surface.document))
}
