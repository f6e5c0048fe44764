//! Reads transforms of ITK (3D Slicer, ANTs, SimpleITK) from text (`.tfm`, `.txt`), HDF5 (`.h5`) and MATLAB (`.mat`) files.
//!
//! JSON is read by `transform_request` in `src/service/contract`, since this package knows no JSON; it gives the same
//! [`ItkTransform`]s. Only transforms that map straight lines to straight lines are read; [`rigid_motion`] then checks that
//! nothing is scaled, sheared or mirrored.
//!
//! ITK writes transforms that map points of the fixed image to the moving one, for resampling; Slicer does the same and writes
//! the inverse of a transform that it shows. The caller decides which way it needs ([`Affine::motion`]).

mod hdf5;
mod itk;
mod matlab;
mod rigid;
mod text;

use super::ImportError;
use super::error::malformed;
pub use itk::{ItkTransform, itk_affine};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
pub use rigid::{NotRigid, RIGID_WITHIN, RigidMotion, rigid_motion, rigid_of_matrix};

/// Longest file, bytes: a rigid transform in HDF5 takes 8 kB.
const MAX_BYTES: usize = 1 << 20;

/// `y = matrix · x + offset_mm`, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// Linear part, dimensionless.
    pub matrix: Matrix3<f64>,
    /// Image of the origin, mm.
    pub offset_mm: Vector,
}

/// File formats of transforms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransformFormat {
    /// ITK's text format, `.tfm` or `.txt`.
    Text,
    /// ITK's HDF5 format, `.h5`.
    Hdf5,
    /// MATLAB 4, `.mat`, as ITK and ANTs write it.
    Matlab,
}

impl TransformFormat {
    /// Name for messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "ITK text",
            Self::Hdf5 => "ITK HDF5",
            Self::Matlab => "ITK MATLAB",
        }
    }
}

/// Guesses the format of a transform from its bytes; `None` when no format fits.
#[must_use]
pub fn detect_transform(bytes: &[u8]) -> Option<TransformFormat> {
    if hdf5::looks_like(bytes) {
        Some(TransformFormat::Hdf5)
    } else if text::looks_like(bytes) {
        Some(TransformFormat::Text)
    } else if matlab::looks_like(bytes) {
        Some(TransformFormat::Matlab)
    } else {
        None
    }
}

/// Reads the transform of a file, as the file states it.
///
/// # Errors
/// [`ImportError::UnknownFormat`]; [`ImportError::Malformed`] for broken files, deformations, and lists of transforms that are no
/// composite transform.
///
/// ```
/// use prosopon_formats::import::{TransformFormat, transform};
///
/// let file = b"#Insight Transform File V1.0
/// #Transform 0
/// Transform: TranslationTransform_double_3_3
/// Parameters: 1.5 -6 -1.25
/// FixedParameters:
/// ";
/// let (read, format) = transform(file)?;
/// assert_eq!((read.offset_mm.as_slice(), format), (&[1.5, -6.0, -1.25][..], TransformFormat::Text));
/// # Ok::<(), prosopon_formats::import::ImportError>(())
/// ```
pub fn transform(bytes: &[u8]) -> Result<(Affine, TransformFormat), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    let expected = "ITK transforms: text (.tfm, .txt), HDF5 (.h5), MATLAB 4 (.mat) and JSON";
    if matlab::is_later_version(bytes) {
        return Err(malformed("MATLAB", "it has version 5 or later; save the transform as .tfm"));
    }
    let format = detect_transform(bytes).ok_or(ImportError::UnknownFormat { expected })?;
    if bytes.len() > MAX_BYTES {
        let detail = format!(
            "it has {} bytes, a rigid transform at most {MAX_BYTES}: is it a deformation field? Save a rigid transform",
            bytes.len()
        );
        return Err(malformed(format.name(), detail));
    }
    let transforms = match format {
        TransformFormat::Text => text::read(bytes)?,
        TransformFormat::Hdf5 => hdf5::read(bytes)?,
        TransformFormat::Matlab => matlab::read(bytes)?,
    };
    Ok((itk_affine(&transforms).map_err(|detail| malformed(format.name(), detail))?, format))
}

#[cfg(test)]
pub(super) mod tests;
