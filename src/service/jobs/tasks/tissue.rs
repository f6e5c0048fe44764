use crate::Service;
use prosopon_contract::{Fault, FaultKind, Halt, TissueDocument, import_fault, to_json};
use prosopon_formats::import::volume_mesh;
use prosopon_planning::simulate::ReadyMesh;
use prosopon_store::{BlobInfo, PartKind, PartRecord, SessionId, now_rfc3339};

/// Reads, checks and stores an uploaded tissue mesh as a part of the session.
///
/// A refused upload's blob is removed.
///
/// # Errors
/// [`FaultKind::MeshNotUsable`], [`FaultKind::UnsupportedFormat`], or the store's.
pub async fn take_tissue(service: &Service, session: SessionId, upload: BlobInfo) -> Result<TissueDocument, Fault> {
    let checked = check(service, &upload).await;
    let document = match checked {
        Ok(document) => document,
        Err(fault) => {
            service.store.blobs().delete(&upload.key).await;
            return Err(if fault.kind == FaultKind::MeshNotUsable {
                fault.at(PartKind::Tissue.as_str())
            } else {
                fault
            });
        }
    };
    let part = PartRecord {
        kind: PartKind::Tissue,
        key: upload.sha256,
        blob: Some(upload.key),
        bytes: upload.bytes,
        wall_s: 0.0,
        document: to_json("the description of the tissue mesh", &document)?,
        updated_at: now_rfc3339(),
    };
    service.store.put_parts(session, &[part]).await?;
    Ok(document)
}

async fn check(service: &Service, upload: &BlobInfo) -> Result<TissueDocument, Fault> {
    let bytes = service.store.blobs().get(&upload.key).await?;
    let limits = service.settings.import;
    let (length, sha256) = (upload.bytes, upload.sha256.clone());
    service
        .compute(move |_, _| {
            let (volume, warnings) =
                volume_mesh(&bytes, &limits).map_err(|e| Halt::from(import_fault(&e, FaultKind::MeshNotUsable)))?;
            drop(bytes);
            let ready =
                ReadyMesh::new(&volume).map_err(|e| Halt::from(Fault::new(FaultKind::MeshNotUsable, e.to_string())))?;
            ready.check_support().map_err(|e| Halt::from(Fault::new(FaultKind::MeshNotUsable, e.to_string())))?;
            Ok(TissueDocument::new(sha256, length, &volume, &ready, warnings))
        })
        .await
}
