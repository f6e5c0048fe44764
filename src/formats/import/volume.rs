use super::archive::{self, Archive};
use super::error::{check_size, malformed};
use super::{ImportError, Limits, dicom, meta_image, nifti1, nrrd};
use prosopon_geometry::{Aabb, Point, Vector, Volume};

/// File formats of volumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VolumeFormat {
    /// NIfTI-1 in one file (`.nii`), plain or gzipped.
    Nifti,
    /// One DICOM image.
    Dicom,
    /// NRRD with header and voxels in one file.
    Nrrd,
    /// MetaImage: `.mha`, or `.mhd` with its voxel file in an archive.
    MetaImage,
    /// A zip archive of a DICOM series, or of one volume in another format.
    Zip,
}

impl VolumeFormat {
    /// Short lower-case name, for example `nifti`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nifti => "nifti",
            Self::Dicom => "dicom",
            Self::Nrrd => "nrrd",
            Self::MetaImage => "metaimage",
            Self::Zip => "zip",
        }
    }
}

/// Selects one of several DICOM series.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SeriesChoice {
    /// The series with this SeriesInstanceUID.
    Uid(String),
    /// The series with this number, from 1, in the order of the identifiers; warnings list series by this number.
    Number(usize),
}

impl SeriesChoice {
    /// [`SeriesChoice::Number`] when `text` is a number, else [`SeriesChoice::Uid`].
    #[must_use]
    pub fn of(text: &str) -> Self {
        text.parse().map_or_else(|_| Self::Uid(text.to_owned()), Self::Number)
    }
}

/// Settings for reading a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeSettings {
    /// The DICOM series to read; the largest CT series when absent.
    pub series: Option<SeriesChoice>,
    /// Accepts series of other modalities than CT.
    pub any_modality: bool,
    /// Largest step between unevenly spaced DICOM slices that is interpolated, mm.
    pub max_step_mm: f64,
}

impl Default for VolumeSettings {
    fn default() -> Self {
        Self { series: None, any_modality: false, max_step_mm: 5.0 }
    }
}

/// A volume with the format and warnings of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeRead {
    /// The volume.
    pub volume: Volume,
    /// Format of the file that holds the voxels; inside a zip archive, that of the packed file.
    pub format: VolumeFormat,
    /// Number of the DICOM series that was read, from 1, when there are several.
    pub series: Option<usize>,
    /// Changes that were made, and doubtful content.
    pub warnings: Vec<String>,
}

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
    let of = |volume, warnings| VolumeRead { volume, format, series: None, warnings };
    match format {
        VolumeFormat::Nifti => nifti1::read(bytes, limits).map(|(volume, warnings)| of(volume, warnings)),
        VolumeFormat::Nrrd => nrrd::read(bytes, limits, &mut warnings).map(|volume| of(volume, warnings)),
        VolumeFormat::MetaImage => {
            meta_image::read(bytes, limits, &mut |_| Err(APART), &mut warnings).map(|volume| of(volume, warnings))
        }
        VolumeFormat::Dicom => {
            let found = dicom::headers(bytes)?.into_iter().map(|h| (0, h)).collect();
            let (volume, _) = dicom::assemble(found, &|_| Ok(bytes.to_vec()), limits, settings, &mut warnings)?;
            Ok(of(volume, warnings))
        }
        VolumeFormat::Zip => from_archive(bytes, limits, settings),
    }
}

/// Reads a CT volume with default settings; returns it with warnings.
///
/// # Errors
/// As [`volume_with`].
pub fn volume(bytes: &[u8], limits: &Limits) -> Result<(Volume, Vec<String>), ImportError> {
    volume_with(bytes, limits, &VolumeSettings::default()).map(|found| (found.volume, found.warnings))
}

pub(super) const UNKNOWN: ImportError = ImportError::UnknownFormat {
    expected: "NIfTI-1, plain (.nii) or gzipped (.nii.gz), NRRD (.nrrd), MetaImage (.mha), \
               a zip archive of DICOM images or of one of these",
};
const APART: &str = "the voxels are in a separate file: send it with the header in one zip archive";

fn from_archive(bytes: &[u8], limits: &Limits, settings: &VolumeSettings) -> Result<VolumeRead, ImportError> {
    let mut archive = Archive::open(bytes, limits)?;
    let mut warnings = Vec::new();
    let (mut images, mut volumes, mut others) = (Vec::new(), Vec::new(), 0usize);
    for index in 0..archive.len() {
        if archive.name(index).is_none() {
            continue;
        }
        let beginning = archive.beginning(index, SHOWING as u64)?;
        match detect_volume(&beginning) {
            Some(VolumeFormat::Dicom) => match dicom::headers(&archive.read(index, dicom::MAX_FILE)?) {
                Ok(none) if none.is_empty() => others = others.saturating_add(1),
                Ok(found) => images.extend(found.into_iter().map(|header| (index, header))),
                Err(ImportError::Malformed { format, detail }) => {
                    return Err(malformed(format, format!("file {}: {detail}", index.saturating_add(1))));
                }
                Err(other) => return Err(other),
            },
            Some(VolumeFormat::Zip) | None => others = others.saturating_add(1),
            Some(VolumeFormat::Nifti | VolumeFormat::Nrrd | VolumeFormat::MetaImage) => volumes.push(index),
        }
    }
    match (images.is_empty(), volumes.as_slice()) {
        (true, &[index]) => {
            let whole = archive.read(index, archive_file_limit(limits))?;
            let format = detect_volume(&whole).ok_or(UNKNOWN)?;
            if format != VolumeFormat::MetaImage {
                return volume_with(&whole, limits, settings);
            }
            let at_most = archive_file_limit(limits);
            let mut fetch = |name: &str| {
                let index = archive.find(name).ok_or("the voxel file that the header names is not in the archive")?;
                archive.read(index, at_most).map_err(|_| "the voxel file is damaged or too large")
            };
            let volume = meta_image::read(&whole, limits, &mut fetch, &mut warnings)?;
            Ok(VolumeRead { volume, format, series: None, warnings })
        }
        (true, []) => {
            Err(malformed(archive::FORMAT, "the archive holds no DICOM images and no volume of another format"))
        }
        (true, _) => Err(malformed(archive::FORMAT, "the archive holds several volumes, expected one")),
        (false, _) => {
            let others = others.saturating_add(volumes.len());
            if others > 0 {
                warnings.push(format!("{others} files that are not images were skipped"));
            }
            let fetch = |index: usize| archive.clone().read(index, dicom::MAX_FILE);
            let (volume, series) = dicom::assemble(images, &fetch, limits, settings, &mut warnings)?;
            Ok(VolumeRead { volume, format: VolumeFormat::Dicom, series, warnings })
        }
    }
}

/// Largest file in an archive, bytes: voxels of eight bytes and a header.
fn archive_file_limit(limits: &Limits) -> u64 {
    (limits.max_voxels as u64).saturating_mul(8).saturating_add(1 << 20)
}

/// Checks the size of the box around all voxels.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn check_extent(
    dims: [usize; 3],
    origin: &Point,
    axes: &[Vector; 3],
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    let far = dims.map(|d| d.saturating_sub(1) as f64);
    let corners = (0..8u8).map(|c| {
        let step = |a: u8| if c >> a & 1 == 1 { 1.0 } else { 0.0 };
        origin + axes[0] * (step(0) * far[0]) + axes[1] * (step(1) * far[1]) + axes[2] * (step(2) * far[2])
    });
    check_size(Aabb::of(&corners.collect::<Vec<Point>>()).map_or(0.0, |b| b.diagonal()), warnings)
}
