use prosopon_contract::{Fault, FaultKind, SurfaceDocument, SurfaceOrigin, WarningDocument, to_json};
use prosopon_geometry::{TriMesh, not_solid_reason, surface_report};
use prosopon_store::{PartKind, PartRecord, SessionId, Store, encode_mesh, now_rfc3339};

/// A measured and encoded surface, ready to store. Make it on the CPU pool, because measuring computes.
#[derive(Debug)]
pub struct PreparedSurface {
    document: SurfaceDocument,
    bytes: Vec<u8>,
}

impl PreparedSurface {
    /// Measures and encodes `mesh`, which must bound a solid once its holes are closed.
    ///
    /// # Errors
    /// [`FaultKind::SurfaceNotUsable`].
    pub fn new(
        mesh: &TriMesh,
        origin: SurfaceOrigin,
        warnings: impl IntoIterator<Item: Into<WarningDocument>>,
    ) -> Result<Self, Fault> {
        let report = surface_report(mesh);
        if let Some(detail) = not_solid_reason(mesh, &report) {
            return Err(Fault::new(FaultKind::SurfaceNotUsable, detail));
        }
        Ok(Self { document: SurfaceDocument::new(origin, &report, warnings), bytes: encode_mesh(mesh) })
    }
}

/// Stores the blob of a surface; returns the row to insert, and its document.
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
    let document = to_json("the description of the surface", &surface.document)?;
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
