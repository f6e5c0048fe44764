use super::archive::{self, Archive};
use super::error::malformed;
use super::volume_settings::{VolumeFormat, VolumeRead, VolumeSettings};
use super::{ImportError, Limits, dicom, meta_image, nifti1, nrrd};
use prosopon_geometry::{Volume, Warning};

/// Number of first bytes that [`detect_volume`] needs.
pub(super) const SHOWING: usize = 256;

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

/// Reads a CT volume of any [`VolumeFormat`] and converts it to LPS and Hounsfield units.
///
/// Returns the volume and warnings about changes (for example values that were clamped) and doubtful content (for example
/// a header without orientation). An oblique or sheared lattice is kept. Unevenly spaced slices are interpolated linearly to
/// even steps.
///
/// # Errors
/// [`ImportError`] with the fault and its position.
pub fn volume_with(bytes: &[u8], limits: &Limits, settings: &VolumeSettings) -> Result<VolumeRead, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    let format = detect_volume(bytes).ok_or(UNKNOWN)?;
    let mut warnings = Vec::new();
    let volume = match format {
        VolumeFormat::Nifti => nifti1::read(bytes, limits, &mut warnings)?,
        VolumeFormat::Nrrd => nrrd::read(bytes, limits, &mut warnings)?,
        VolumeFormat::MetaImage => meta_image::read(bytes, limits, &mut |_| Err(SEPARATE_VOXELS), &mut warnings)?,
        VolumeFormat::Dicom => {
            let found = dicom::headers(bytes)?.into_iter().map(|h| (0, h)).collect();
            dicom::assemble(found, &|_| Ok(bytes.to_vec()), limits, settings, &mut warnings)?.volume
        }
        VolumeFormat::Zip => return from_archive(bytes, limits, settings),
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

pub(super) const UNKNOWN: ImportError = ImportError::UnknownFormat {
    expected: "NIfTI-1, plain (.nii) or gzipped (.nii.gz), NRRD (.nrrd), MetaImage (.mha), \
               a zip archive of DICOM images or of one of these",
};
const SEPARATE_VOXELS: &str = "the voxels are in a separate file: send it with the header in one zip archive";

/// Files of an archive by content; `others` counts files that are no images.
#[derive(Default)]
struct Contents {
    images: Vec<(usize, dicom::Header)>,
    volumes: Vec<usize>,
    others: usize,
}

impl Contents {
    fn of(archive: &mut Archive<'_>) -> Result<Self, ImportError> {
        let mut contents = Self::default();
        for index in 0..archive.len() {
            if archive.name(index).is_none() {
                continue;
            }
            let beginning = archive.beginning(index, SHOWING as u64)?;
            match detect_volume(&beginning) {
                Some(VolumeFormat::Dicom) => contents.add_dicom(archive, index)?,
                Some(VolumeFormat::Zip) | None => contents.others = contents.others.saturating_add(1),
                Some(VolumeFormat::Nifti | VolumeFormat::Nrrd | VolumeFormat::MetaImage) => {
                    contents.volumes.push(index)
                }
            }
        }
        Ok(contents)
    }

    fn add_dicom(&mut self, archive: &mut Archive<'_>, index: usize) -> Result<(), ImportError> {
        let found = dicom::headers(&archive.read(index, dicom::MAX_FILE)?).map_err(|e| e.in_file(index))?;
        if found.is_empty() {
            self.others = self.others.saturating_add(1);
        }
        self.images.extend(found.into_iter().map(|header| (index, header)));
        Ok(())
    }
}

fn from_archive(bytes: &[u8], limits: &Limits, settings: &VolumeSettings) -> Result<VolumeRead, ImportError> {
    let mut archive = Archive::open(bytes, limits)?;
    let Contents { images, volumes, others } = Contents::of(&mut archive)?;
    match (images.is_empty(), volumes.as_slice()) {
        (true, &[index]) => packed_volume(&mut archive, index, limits, settings),
        (true, []) => {
            Err(malformed(archive::FORMAT, "the archive holds no DICOM images and no volume of another format"))
        }
        (true, _) => Err(malformed(archive::FORMAT, "the archive holds several volumes, expected one")),
        (false, _) => {
            let mut warnings = Vec::new();
            let others = others.saturating_add(volumes.len());
            if others > 0 {
                warnings
                    .push(Warning::info("files-skipped", format!("{others} files that are not images were skipped")));
            }
            let fetch = |index: usize| archive.clone().read(index, dicom::MAX_FILE);
            let found = dicom::assemble(images, &fetch, limits, settings, &mut warnings)?;
            Ok(VolumeRead { volume: found.volume, format: VolumeFormat::Dicom, series: found.series, warnings })
        }
    }
}

/// Reads the only volume of an archive, file `index`.
fn packed_volume(
    archive: &mut Archive<'_>,
    index: usize,
    limits: &Limits,
    settings: &VolumeSettings,
) -> Result<VolumeRead, ImportError> {
    let at_most = archive::max_unpacked(limits);
    let whole = archive.read(index, at_most)?;
    let format = detect_volume(&whole).ok_or(UNKNOWN)?;
    if format != VolumeFormat::MetaImage {
        return volume_with(&whole, limits, settings);
    }
    let mut fetch = |name: &str| {
        let index = archive.find(name).ok_or("the voxel file that the header names is not in the archive")?;
        archive.read(index, at_most).map_err(|_| "the voxel file is damaged or too large")
    };
    let mut warnings = Vec::new();
    let volume = meta_image::read(&whole, limits, &mut fetch, &mut warnings)?;
    Ok(VolumeRead { volume, format, series: None, warnings })
}
