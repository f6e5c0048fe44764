use crate::import::{VOLUME_BEGINNING, check_volume};
use crate::jobs::Service;
use crate::session::{Fault, FaultKind, import_fault};
use crate::store::{BlobInfo, PartKind};

/// Checks an uploaded CT by its beginning, so that a file that cannot be one is refused before a job takes it.
///
/// # Errors
/// [`FaultKind::VolumeNotUsable`], [`FaultKind::UnsupportedFormat`], or the store's.
pub async fn check_ct(service: &Service, upload: &BlobInfo) -> Result<(), Fault> {
    // No range of an empty file can be read.
    let beginning = match upload.bytes {
        0 => Vec::new().into(),
        length => service.store.blobs().get_range(&upload.key, 0..length.min(VOLUME_BEGINNING)).await?,
    };
    let checked = check_volume(&beginning, upload.bytes, &service.settings.import);
    checked.map_err(|error| match import_fault(&error, FaultKind::VolumeNotUsable) {
        fault if fault.kind == FaultKind::VolumeNotUsable => fault.at(PartKind::Ct.as_str()),
        fault => fault,
    })
}
