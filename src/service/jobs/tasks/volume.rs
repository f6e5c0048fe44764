use std::sync::Arc;

use bytes::Bytes;

use crate::Service;
use prosopon_contract::{CtDocument, Fault, FaultKind, Halt, import_fault, to_json};
use prosopon_formats::export::nifti_gz;
use prosopon_formats::import::{ImportError, VolumeCheck, VolumeSettings, volume_with};
use prosopon_store::{BlobInfo, PartKind, PartRecord, SessionId, now_rfc3339};

/// Bytes that are scanned at once, on a thread for requests.
const BATCH: usize = 1 << 20;
/// Smallest number of voxels along an axis for extracting surfaces.
const MIN_EXTENT: usize = 4;

/// Scans a CT while it arrives, and refuses a wrong or truncated file before a job takes it.
#[derive(Debug)]
pub struct CtScan {
    service: Arc<Service>,
    scan: VolumeCheck,
    waiting: Vec<Bytes>,
    bytes: usize,
}

impl CtScan {
    /// A scan before the first piece.
    #[must_use]
    pub fn new(service: &Arc<Service>) -> Self {
        let scan = VolumeCheck::new(service.settings.import);
        Self { service: Arc::clone(service), scan, waiting: Vec::new(), bytes: 0 }
    }

    /// Takes the next piece; waits while a batch is scanned.
    ///
    /// # Errors
    /// [`FaultKind::VolumeNotUsable`], [`FaultKind::UnsupportedFormat`].
    pub async fn take(&mut self, piece: Bytes) -> Result<(), Fault> {
        self.bytes += piece.len();
        self.waiting.push(piece);
        if self.bytes >= BATCH { self.look().await } else { Ok(()) }
    }

    /// Checks that the file is complete, as far as a scan without decoding can tell.
    ///
    /// # Errors
    /// As [`CtScan::take`].
    pub async fn finish(mut self) -> Result<(), Fault> {
        self.look().await?;
        let scan = self.scan;
        self.service.compute(move |_, _| scan.finish().map_err(|e| refused(&e))).await
    }

    async fn look(&mut self) -> Result<(), Fault> {
        self.bytes = 0;
        let pieces = std::mem::take(&mut self.waiting);
        let mut scan = std::mem::replace(&mut self.scan, VolumeCheck::new(self.service.settings.import));
        let looked = self.service.compute(move |_, _| {
            for piece in &pieces {
                scan.push(piece).map_err(|e| refused(&e))?;
            }
            Ok(scan)
        });
        self.scan = looked.await?;
        Ok(())
    }
}

/// Makes an upload the session's CT; the caller stores the returned part, whose document is the second value.
///
/// Whatever the format, only the voxels and their positions are stored, as NIfTI, so that no tag of a patient and no note in a
/// header outlives the request. The upload's blob is then removed.
///
/// # Errors
/// [`FaultKind::VolumeNotUsable`], [`FaultKind::UnsupportedFormat`], or the store's.
pub async fn take_ct(
    service: &Service,
    session: SessionId,
    upload: BlobInfo,
    settings: VolumeSettings,
) -> Result<(PartRecord, CtDocument), Fault> {
    let read = read_ct(service, &upload, settings).await;
    service.store.blobs().delete(&upload.key).await;
    let (packed, document) = read?;
    let stored = service.store.blobs().put(session, packed).await?;
    let part = PartRecord {
        kind: PartKind::Ct,
        key: stored.sha256,
        blob: Some(stored.key),
        bytes: stored.bytes,
        wall_s: 0.0,
        document: to_json("the description of the CT", &document)?,
        updated_at: now_rfc3339(),
    };
    Ok((part, document))
}

/// A CT as NIfTI, and what was read.
async fn read_ct(
    service: &Service,
    upload: &BlobInfo,
    settings: VolumeSettings,
) -> Result<(Vec<u8>, CtDocument), Fault> {
    let bytes = service.store.blobs().get(&upload.key).await?;
    let (sha256, size) = (upload.sha256.clone(), upload.bytes);
    let limits = service.settings.import;
    service
        .compute(move |_, _| {
            let read = volume_with(&bytes, &limits, &settings).map_err(|e| refused(&e))?;
            drop(bytes);
            let dims = read.volume.dims;
            if dims.iter().any(|d| *d < MIN_EXTENT) {
                let detail = format!("the volume has {dims:?} voxels; it needs at least {MIN_EXTENT} along each axis");
                return Err(Fault::new(FaultKind::VolumeNotUsable, detail).at(PartKind::Ct.as_str()).into());
            }
            let packed = nifti_gz(&read.volume)
                .map_err(|e| Fault::new(FaultKind::VolumeNotUsable, e.to_string()).at(PartKind::Ct.as_str()))?;
            Ok((packed, CtDocument::of(&read, sha256, size)))
        })
        .await
}

fn refused(error: &ImportError) -> Halt {
    match import_fault(error, FaultKind::VolumeNotUsable) {
        fault if fault.kind == FaultKind::VolumeNotUsable => fault.at(PartKind::Ct.as_str()).into(),
        fault => fault.into(),
    }
}
