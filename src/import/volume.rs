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

/// Looks over a CT file while it arrives, without keeping it: whether [`volume`] would find a header that it reads, and
/// all voxels. A gzipped file is unpacked on the way.
#[derive(Debug)]
pub struct VolumeScan {
    limits: Limits,
    /// The first bytes, until they show the format.
    beginning: Vec<u8>,
    scan: Option<nifti1::Scan>,
}

/// Bytes that show the format.
const SHOWING: usize = 4;

impl VolumeScan {
    /// A scan that has seen nothing yet.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, beginning: Vec::new(), scan: None }
    }

    /// Takes the next piece of the file.
    ///
    /// # Errors
    /// [`ImportError`], as soon as what came shows that the file cannot be read.
    pub fn push(&mut self, piece: &[u8]) -> Result<(), ImportError> {
        if let Some(scan) = &mut self.scan {
            return scan.push(piece);
        }
        self.beginning.extend_from_slice(piece);
        if self.beginning.len() < SHOWING { Ok(()) } else { self.begin().map(|_| ()) }
    }

    fn begin(&mut self) -> Result<&mut nifti1::Scan, ImportError> {
        recognise(&self.beginning)?;
        let mut scan = nifti1::Scan::new(&self.beginning, self.limits);
        scan.push(&std::mem::take(&mut self.beginning))?;
        Ok(self.scan.insert(scan))
    }

    /// Whether the file that ended here is whole.
    ///
    /// # Errors
    /// [`ImportError`], as [`volume`] would say it of the whole file.
    pub fn finish(mut self) -> Result<(), ImportError> {
        if self.scan.is_none() {
            self.begin()?;
        }
        self.scan.map_or(Err(ImportError::Empty), nifti1::Scan::finish)
    }
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
