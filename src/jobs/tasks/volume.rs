use std::sync::Arc;

use axum::body::Bytes;

use crate::import::{ImportError, VolumeScan};
use crate::jobs::Service;
use crate::session::{Fault, FaultKind, Halt, import_fault};
use crate::store::PartKind;

/// Bytes that are looked over at once, on a thread for requests.
const BATCH: usize = 1 << 20;

/// Looks over a CT while it arrives, so that a file that cannot be one, or is cut off, is refused before a job takes it.
#[derive(Debug)]
pub struct CtScan {
    service: Arc<Service>,
    scan: VolumeScan,
    waiting: Vec<Bytes>,
    bytes: usize,
}

impl CtScan {
    /// A scan that has seen nothing yet.
    #[must_use]
    pub fn new(service: &Arc<Service>) -> Self {
        let scan = VolumeScan::new(service.settings.import);
        Self { service: Arc::clone(service), scan, waiting: Vec::new(), bytes: 0 }
    }

    /// Takes the next piece; waits while a batch is looked over.
    ///
    /// # Errors
    /// [`FaultKind::VolumeNotUsable`], [`FaultKind::UnsupportedFormat`].
    pub async fn take(&mut self, piece: Bytes) -> Result<(), Fault> {
        self.bytes += piece.len();
        self.waiting.push(piece);
        if self.bytes >= BATCH { self.look().await } else { Ok(()) }
    }

    /// Whether what came is a whole file.
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
        let mut scan = std::mem::replace(&mut self.scan, VolumeScan::new(self.service.settings.import));
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

fn refused(error: &ImportError) -> Halt {
    match import_fault(error, FaultKind::VolumeNotUsable) {
        fault if fault.kind == FaultKind::VolumeNotUsable => fault.at(PartKind::Ct.as_str()).into(),
        fault => fault.into(),
    }
}
