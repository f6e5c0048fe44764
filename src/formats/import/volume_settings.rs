use super::ImportError;
use super::error::malformed;
use prosopon_geometry::{Volume, Warning};

/// File formats of volumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VolumeFormat {
    /// NIfTI-1: `.nii`, plain or gzipped, or `.hdr` with its `.img` in an archive.
    Nifti,
    /// One DICOM image.
    Dicom,
    /// NRRD: `.nrrd`, or `.nhdr` with its voxel files in an archive.
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
    /// The stack to read, from 1, in the order of the refusal that lists them: an acquisition, time point, phase, reconstruction or
    /// direction of a DICOM series, or a time point of a file with four dimensions.
    pub stack: Option<usize>,
    /// The volume to read, from 1, of an archive of several that are not DICOM, in the order of the refusal that lists them.
    pub volume: Option<usize>,
    /// HU per stored number, instead of what the file says.
    pub rescale_slope: Option<f64>,
    /// HU of the stored number zero, instead of what the file says.
    pub rescale_intercept: Option<f64>,
    /// Accepts series of other modalities than CT.
    pub any_modality: bool,
    /// Largest step between unevenly spaced DICOM slices that is interpolated, mm.
    pub max_step_mm: f64,
}

impl Default for VolumeSettings {
    fn default() -> Self {
        Self {
            series: None,
            stack: None,
            volume: None,
            rescale_slope: None,
            rescale_intercept: None,
            any_modality: false,
            max_step_mm: 5.0,
        }
    }
}

impl VolumeSettings {
    /// Slope and intercept of a file, or those that replace them.
    pub(super) fn rescale(&self, slope: f64, intercept: f64) -> (f64, f64) {
        (self.rescale_slope.unwrap_or(slope), self.rescale_intercept.unwrap_or(intercept))
    }

    /// Notes which numbers replaced those of the file.
    pub(super) fn note_rescale(&self, warnings: &mut Vec<Warning>) {
        let part = |name: &str, value: Option<f64>| value.map(|value| format!("the rescale {name} {value}"));
        let given: Vec<String> = [part("slope", self.rescale_slope), part("intercept", self.rescale_intercept)]
            .into_iter()
            .flatten()
            .collect();
        if !given.is_empty() {
            let found = format!("{} of the request replaced what the file says", given.join(" and "));
            warnings.push(Warning::info("rescale-given", found));
        }
    }

    /// Index of the stack to read of a file that holds `n` volumes one after another.
    pub(super) fn stack_of(&self, format: &'static str, n: usize) -> Result<usize, ImportError> {
        match self.stack {
            None if n == 1 => Ok(0),
            None => {
                let detail = format!(
                    "the file holds {n} volumes (time points or phases), expected one; choose one with `stack`, 1 to {n}"
                );
                Err(malformed(format, detail))
            }
            Some(number) => number.checked_sub(1).filter(|at| *at < n).ok_or_else(|| {
                malformed(format, format!("stack {number} was requested, but the file has stacks 1 to {n}"))
            }),
        }
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
    pub warnings: Vec<Warning>,
}
