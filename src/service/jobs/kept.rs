//! Fields and tissue meshes that outlive the process that built them, as blobs of a session's parts.

use std::sync::Arc;

use super::Service;
use prosopon_contract::Fault;
use prosopon_session::{Case, Kept, SessionParts};
use prosopon_store::{PartKind, PartRecord};

/// The part that holds the stored form of a result.
fn part_of(kept: Kept) -> PartKind {
    match kept {
        Kept::Fields => PartKind::Field,
        Kept::Tissue => PartKind::Mesh,
    }
}

/// The part with the stored form of the result under `key`.
fn stored<'a>(parts: &'a SessionParts, kept: Kept, key: &str) -> Option<&'a PartRecord> {
    parts.get(part_of(kept)).filter(|part| part.key == key && part.blob.is_some())
}

/// Whether the result under `key` is in memory or stored, so that it need not be built.
pub fn is_kept(service: &Service, parts: &SessionParts, kept: Kept, key: &str) -> bool {
    service.engine.has(kept, key) || stored(parts, kept, key).is_some()
}

/// Reads the stored result under `key` into memory, unless it is there.
///
/// One that cannot be read, or that another program wrote, is built again when it is needed.
pub(crate) async fn recall(service: &Service, parts: &SessionParts, kept: Kept, key: &str) {
    if service.engine.has(kept, key) {
        return;
    }
    let Some(part) = stored(parts, kept, key) else { return };
    // One at a time: it takes a second, and several times the memory of the result.
    let _alone = service.recalling.lock().await;
    if service.engine.has(kept, key) {
        return;
    }
    let kind = part.kind.as_str();
    let bytes = match service.store.blobs().get(part.blob.as_deref().unwrap_or_default()).await {
        Ok(bytes) => bytes,
        Err(error) => return tracing::warn!(kind, %error, "a stored result cannot be read and will be built again"),
    };
    let (engine, key) = (Arc::clone(&service.engine), key.to_owned());
    let taken = service.cpu.run_request(move || engine.recall(kept, &key, &bytes)).await;
    tracing::debug!(kind, taken = taken.unwrap_or(false), "a stored result was read");
}

/// The patient case for the numerics, with its fields if they are stored.
///
/// # Errors
/// As [`SessionParts::case`].
pub async fn case_of(service: &Service, parts: &SessionParts) -> Result<Case, Fault> {
    recall(service, parts, Kept::Fields, &parts.field_key()?).await;
    parts.case(&service.store).await
}
