use super::volume_settings::VolumeFormat;
use super::{ImportError, archive, dicom, meta_image, nifti1, nrrd};

/// Number of first bytes that [`detect_volume`] needs.
pub(super) const SHOWING: usize = 256;

pub(super) const UNKNOWN: ImportError = ImportError::UnknownFormat {
    expected: "NIfTI-1, plain (.nii) or gzipped (.nii.gz), NRRD (.nrrd), MetaImage (.mha), \
               a zip archive of DICOM images or of one of these",
};

/// Detects the format of a volume from its first 256 bytes; `None` when no format fits.
#[must_use]
pub fn detect_volume(bytes: &[u8]) -> Option<VolumeFormat> {
    if nifti1::looks_like(bytes) {
        Some(VolumeFormat::Nifti)
    } else if archive::looks_like(bytes) {
        Some(VolumeFormat::Zip)
    } else if nrrd::looks_like(bytes) {
        Some(VolumeFormat::Nrrd)
    } else if meta_image::looks_like(bytes) {
        Some(VolumeFormat::MetaImage)
    } else if dicom::looks_like(bytes) {
        Some(VolumeFormat::Dicom)
    } else {
        None
    }
}
