//! Uploads: raw bodies that stream to disk.

use axum::body::Body;
use axum::http::{HeaderMap, header};
use futures::StreamExt;

use super::{HttpLimits, Problem};
use prosopon_contract::{Fault, FaultKind};
use prosopon_jobs::CtScan;
use prosopon_store::{BlobInfo, SessionId, Store, StoreError};

/// Stores the body while `scan` checks it. On any failure nothing is left on disk.
///
/// The body can have at most `max_bytes` and must fit into the session's quota.
pub(super) async fn receive(
    store: &Store,
    session: SessionId,
    headers: &HeaderMap,
    body: Body,
    max_bytes: u64,
    limits: &HttpLimits,
    mut scan: Option<CtScan>,
) -> Result<BlobInfo, Problem> {
    let room = store.room(session).await?;
    let full = || Problem::from(StoreError::QuotaFull { allowed: store.quota() });
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|l| l.to_str().ok()?.parse::<u64>().ok());
    if let Some(length) = announced.filter(|length| *length > max_bytes) {
        let detail = format!("the upload has {length} bytes, at most {max_bytes} are allowed");
        return Err(Problem(Fault::new(FaultKind::TooLarge, detail).with("allowed_bytes", max_bytes)));
    }
    if announced.is_some_and(|length| length > room) {
        return Err(full());
    }
    let mut upload = store.blobs().upload(session, max_bytes.min(room)).await?;
    let mut pieces = body.into_data_stream();
    loop {
        let piece = match tokio::time::timeout(limits.upload_idle, pieces.next()).await {
            Ok(Some(Ok(piece))) => piece,
            Ok(None) => break,
            Ok(Some(Err(_))) => {
                upload.abort().await;
                return Err(Problem::new(FaultKind::MalformedRequest, "the upload broke off; send it again"));
            }
            Err(_) => {
                upload.abort().await;
                let detail = format!("no data arrived for {} s; send the upload again", limits.upload_idle.as_secs());
                return Err(Problem::new(FaultKind::Timeout, detail));
            }
        };
        if let Some(scan) = &mut scan
            && let Err(refused) = scan.take(piece.clone()).await
        {
            upload.abort().await;
            return Err(refused.into());
        }
        if let Err(error) = upload.write(piece).await {
            upload.abort().await;
            let StoreError::TooLarge { .. } = error else { return Err(error.into()) };
            return Err(if room < max_bytes { full() } else { error.into() });
        }
    }
    if let Some(scan) = scan
        && let Err(refused) = scan.finish().await
    {
        upload.abort().await;
        return Err(refused.into());
    }
    let stored = upload.finish().await?;
    metrics::counter!("prosopon_upload_bytes_total").increment(stored.bytes);
    Ok(stored)
}
