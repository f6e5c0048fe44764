use prosopon_geometry::{Volume, Warning};

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
    pub warnings: Vec<Warning>,
}
