//! Uploads: bodies, or the one file of a form, that stream to disk.

use axum::body::Body;
use axum::http::{HeaderMap, header};

use super::upload_body::UploadBody;
use super::{HttpLimits, Problem};
use prosopon_contract::{Fault, FaultKind};
use prosopon_jobs::CtScan;
use prosopon_store::{BlobInfo, SessionId, Store, StoreError};

/// A stored upload.
#[derive(Debug)]
pub(super) struct Received {
    pub(super) blob: BlobInfo,
    /// Media type of the body, or of the file in a form: a hint on the format.
    pub(super) media_type: Option<String>,
    /// Name of the file in a form: a hint on the format.
    pub(super) file_name: Option<String>,
}

/// Stores the body, or the one file of a form, while `scan` checks it. On any failure nothing is left on disk.
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
) -> Result<Received, Problem> {
    let room = store.room(session).await?;
    let full = || Problem::from(StoreError::QuotaFull { allowed: store.quota() });
    let mut pieces = UploadBody::new(headers, body)?;
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|l| l.to_str().ok()?.parse::<u64>().ok());
    let announced = announced.map(|length| length.saturating_sub(pieces.overhead()));
    if let Some(length) = announced.filter(|length| *length > max_bytes) {
        let detail = format!("the upload has {length} bytes, at most {max_bytes} are allowed");
        return Err(Problem(Fault::new(FaultKind::TooLarge, detail).with("allowed_bytes", max_bytes)));
    }
    if announced.is_some_and(|length| length > room) {
        return Err(full());
    }
    let mut upload = store.blobs().upload(session, max_bytes.min(room)).await?;
    loop {
        let piece = match tokio::time::timeout(limits.upload_idle, pieces.next()).await {
            Ok(Some(Ok(piece))) => piece,
            Ok(None) => break,
            Ok(Some(Err(problem))) => {
                upload.abort().await;
                return Err(problem);
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
    let blob = upload.finish().await?;
    metrics::counter!("prosopon_upload_bytes_total").increment(blob.bytes);
    let hint = |text: Option<&str>| text.map(str::to_owned);
    Ok(Received { blob, media_type: hint(pieces.media_type()), file_name: hint(pieces.file_name()) })
}
