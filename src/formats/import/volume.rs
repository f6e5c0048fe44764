use super::detached::SEPARATE;
use super::error::malformed;
use super::volume_detect::{UNKNOWN, detect_volume};
use super::volume_settings::{VolumeFormat, VolumeRead, VolumeSettings};
use super::{ImportError, Limits, dicom, meta_image, nifti1, nrrd, volume_archive};
use prosopon_geometry::{Volume, Warning};

/// Reads a CT volume of any [`VolumeFormat`] and converts it to LPS and Hounsfield units.
///
/// Returns the volume and warnings about changes (for example values that were clamped) and doubtful content (for example
/// a header without orientation). An oblique or sheared lattice is kept. Unevenly spaced slices are interpolated linearly to
/// even steps. A file of several volumes is refused with a list, unless the settings choose one.
///
/// # Errors
/// [`ImportError`] with the fault and its position.
pub fn volume_with(bytes: &[u8], limits: &Limits, settings: &VolumeSettings) -> Result<VolumeRead, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    let format = detect_volume(bytes).ok_or(UNKNOWN)?;
    let mut read = match format {
        VolumeFormat::Zip => volume_archive::read(bytes, limits, settings)?,
        VolumeFormat::Nifti | VolumeFormat::Nrrd | VolumeFormat::MetaImage | VolumeFormat::Dicom => {
            one_file(bytes, format, limits, settings)?
        }
    };
    settings.note_rescale(&mut read.warnings);
    Ok(read)
}

fn one_file(
    bytes: &[u8],
    format: VolumeFormat,
    limits: &Limits,
    settings: &VolumeSettings,
) -> Result<VolumeRead, ImportError> {
    if let Some(number) = settings.volume.filter(|number| *number != 1) {
        let detail =
            format!("volume {number} was requested, but the upload is one file; `volume` chooses in a zip archive");
        return Err(malformed(format.name(), detail));
    }
    let mut warnings = Vec::new();
    let mut alone = |_: &str| Err(SEPARATE);
    let volume = match format {
        VolumeFormat::Nifti => nifti1::read(bytes, limits, settings, &mut warnings)?,
        VolumeFormat::Nrrd => nrrd::read(bytes, limits, settings, &mut alone, &mut warnings)?,
        VolumeFormat::MetaImage => meta_image::read(bytes, limits, settings, &mut alone, &mut warnings)?,
        VolumeFormat::Dicom => {
            let found = dicom::headers(bytes)?.into_iter().map(|h| (0, h)).collect();
            dicom::assemble(found, &|_| Ok(bytes.to_vec()), limits, settings, &mut warnings)?.volume
        }
        VolumeFormat::Zip => return Err(UNKNOWN),
    };
    Ok(VolumeRead { volume, format, series: None, warnings })
}

/// Reads a CT volume with default settings; returns it with warnings.
///
/// # Errors
/// As [`volume_with`].
pub fn volume(bytes: &[u8], limits: &Limits) -> Result<(Volume, Vec<Warning>), ImportError> {
    volume_with(bytes, limits, &VolumeSettings::default()).map(|found| (found.volume, found.warnings))
}
