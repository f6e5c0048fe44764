use super::volume_detect::{SHOWING, UNKNOWN, detect_volume};
use super::volume_settings::VolumeFormat;
use super::{ImportError, Limits, nifti1};

/// Checks a CT file while it arrives, without keeping it.
///
/// The format must be supported. Of a NIfTI file, plain or gzipped, the scan also checks the header and that all voxels are
/// present. Of other formats it checks only the beginning.
#[derive(Debug)]
pub struct VolumeCheck {
    limits: Limits,
    /// The first bytes, until the format is known.
    beginning: Vec<u8>,
    format: Option<VolumeFormat>,
    scan: Option<nifti1::Scan>,
}

impl VolumeCheck {
    /// A scan before the first piece.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, beginning: Vec::new(), format: None, scan: None }
    }

    /// Takes the next piece of the file.
    ///
    /// # Errors
    /// [`ImportError`] as soon as the pieces show that the file cannot be read.
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

    /// Ends the scan: checks that the file is complete, as far as its format was checked.
    ///
    /// # Errors
    /// [`ImportError`] as [`super::volume()`] gives it for the whole file.
    pub fn finish(mut self) -> Result<(), ImportError> {
        if self.format.is_none() {
            self.begin()?;
        }
        self.scan.map_or(Ok(()), nifti1::Scan::finish)
    }
}
