use super::{ImportError, Limits, nifti1};
use crate::geometry::{Point, Vector};

/// A CT volume in Hounsfield units.
///
/// Voxel `(i, j, k)` is centred at `origin + i axes[0] + j axes[1] + k axes[2]` (LPS mm) and stored at
/// `i + dims[0] * (j + dims[1] * k)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Voxels along i, j, k.
    pub dims: [usize; 3],
    /// Centre of voxel (0, 0, 0), LPS mm.
    pub origin: Point,
    /// Step from one voxel to the next along i, j and k, LPS mm.
    pub axes: [Vector; 3],
    /// Hounsfield units, i fastest.
    pub hu: Vec<i16>,
}

/// Reads a CT volume: NIfTI-1, plain or gzipped. RAS is turned into LPS.
///
/// Returns the volume and warnings about what was changed (for example values that were clamped) or looks doubtful
/// (for example an orientation that the file does not state).
///
/// # Errors
/// [`ImportError`] naming the fault and its place.
pub fn volume(bytes: &[u8], limits: &Limits) -> Result<(Volume, Vec<String>), ImportError> {
    recognise(bytes)?;
    nifti1::read(bytes, limits)
}

/// Bytes from the beginning of a file that [`check_volume`] needs: a gzipped header is in them.
pub const VOLUME_BEGINNING: u64 = 1 << 16;

/// Checks what the beginning of a file of `length` bytes tells, without reading a voxel.
///
/// # Errors
/// [`ImportError`], as [`volume`] would say it of the whole file.
pub fn check_volume(beginning: &[u8], length: u64, limits: &Limits) -> Result<(), ImportError> {
    recognise(beginning)?;
    nifti1::check(beginning, length, limits)
}

fn recognise(bytes: &[u8]) -> Result<(), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    if nifti1::looks_like(bytes) {
        return Ok(());
    }
    Err(ImportError::UnknownFormat { expected: "NIfTI-1, plain (.nii) or gzipped (.nii.gz)" })
}
