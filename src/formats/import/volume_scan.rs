use super::volume::{SHOWING, UNKNOWN, detect_volume};
use super::{ImportError, Limits, VolumeFormat, nifti1};

/// Looks over a CT file while it arrives, without keeping it: whether its format is read, and for NIfTI whether there is a header
/// that is read, and all voxels. A gzipped file is unpacked on the way. Of other formats no more than the beginning is looked at.
#[derive(Debug)]
pub struct VolumeScan {
    limits: Limits,
    /// The first bytes, until they show the format.
    beginning: Vec<u8>,
    format: Option<VolumeFormat>,
    scan: Option<nifti1::Scan>,
}

impl VolumeScan {
    /// A scan that has seen nothing yet.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, beginning: Vec::new(), format: None, scan: None }
    }

    /// Takes the next piece of the file.
    ///
    /// # Errors
    /// [`ImportError`], as soon as what came shows that the file cannot be read.
    pub fn push(&mut self, piece: &[u8]) -> Result<(), ImportError> {
        match (&mut self.scan, self.format) {
            (Some(scan), _) => return scan.push(piece),
            (None, Some(_)) => return Ok(()),
            (None, None) => self.beginning.extend_from_slice(piece),
        }
        if self.beginning.len() < SHOWING { Ok(()) } else { self.begin() }
    }

    fn begin(&mut self) -> Result<(), ImportError> {
        if self.beginning.is_empty() {
            return Err(ImportError::Empty);
        }
        let beginning = std::mem::take(&mut self.beginning);
        let format = detect_volume(&beginning).ok_or(UNKNOWN)?;
        self.format = Some(format);
        if format == VolumeFormat::Nifti {
            self.scan.insert(nifti1::Scan::new(&beginning, self.limits)).push(&beginning)?;
        }
        Ok(())
    }

    /// Whether the file that ended here is whole, as far as it was looked at.
    ///
    /// # Errors
    /// [`ImportError`], as [`super::volume()`] would say it of the whole file.
    pub fn finish(mut self) -> Result<(), ImportError> {
        if self.format.is_none() {
            self.begin()?;
        }
        self.scan.map_or(Ok(()), nifti1::Scan::finish)
    }
}
