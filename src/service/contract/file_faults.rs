use std::fmt;

use super::check::Check;

/// Values of a file that are not allowed, each with its JSON pointer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileFaults(Vec<(String, String)>);

impl FileFaults {
    /// Fails with the faults of `check`, if there are any.
    ///
    /// # Errors
    /// The faults.
    pub fn finish(check: Check) -> Result<(), Self> {
        let Err(fault) = check.finish() else { return Ok(()) };
        Err(Self(fault.errors.into_iter().map(|e| (e.pointer, e.detail)).collect()))
    }
}

impl fmt::Display for FileFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (pointer, detail)) in self.0.iter().enumerate() {
            let comma = if index > 0 { ", " } else { "" };
            write!(f, "{comma}{pointer} {detail}")?;
        }
        Ok(())
    }
}

impl std::error::Error for FileFaults {}
