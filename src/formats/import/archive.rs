//! Reads the files of a zip archive, each into bounded memory.

use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

use super::error::{at_most, malformed};
use super::{ImportError, Limits};

pub(super) const FORMAT: &str = "zip";
/// Most files in an archive; no examination has so many.
const MAX_FILES: usize = 50_000;

/// Most unpacked bytes: voxels of eight bytes, the largest number type, and a header.
pub(super) fn max_unpacked(limits: &Limits) -> u64 {
    (limits.max_voxels as u64).saturating_mul(8).saturating_add(1 << 20)
}

/// An archive in memory.
#[derive(Debug, Clone)]
pub(super) struct Archive<'a> {
    zip: ZipArchive<Cursor<&'a [u8]>>,
}

/// Whether these may be the bytes of a zip archive.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

impl<'a> Archive<'a> {
    /// Reads the list of files and checks their unpacked size against that of the largest volume.
    pub(super) fn open(bytes: &'a [u8], limits: &Limits) -> Result<Self, ImportError> {
        let mut zip = ZipArchive::new(Cursor::new(bytes)).map_err(|e| fault(&e))?;
        at_most("files in an archive", zip.len() as u64, MAX_FILES)?;
        // Overlapping files unpack to far more than the archive holds: a zip bomb.
        if zip.has_overlapping_entries().map_err(|e| fault(&e))? {
            return Err(malformed(FORMAT, "files in the archive overlap"));
        }
        let mut unpacked = 0u64;
        for index in 0..zip.len() {
            unpacked = unpacked.saturating_add(zip.by_index_raw(index).map_err(|e| fault(&e))?.size());
        }
        at_most("unpacked bytes", unpacked, usize::try_from(max_unpacked(limits)).unwrap_or(usize::MAX))?;
        Ok(Self { zip })
    }

    pub(super) fn len(&self) -> usize {
        self.zip.len()
    }

    /// The file's name without folders; `None` for folders and for files that operating systems add.
    pub(super) fn name(&self, index: usize) -> Option<String> {
        let path = self.zip.name_for_index(index)?.ok()?.into_owned();
        let name = path.rsplit(['/', '\\']).next().unwrap_or_default();
        let left_behind =
            path.starts_with("__MACOSX/") || name.starts_with("._") || matches!(name, ".DS_Store" | "Thumbs.db");
        (!name.is_empty() && !left_behind).then(|| name.to_owned())
    }

    /// The file's path; `None` for what [`Archive::name`] leaves out.
    fn path(&self, index: usize) -> Option<String> {
        self.name(index)?;
        Some(self.zip.name_for_index(index)?.ok()?.replace('\\', "/"))
    }

    /// Index of the file with that name beside file `index`; a name in other letters or the only such file of another folder does
    /// too. A folder in `name` is dropped: only files of the archive are read.
    pub(super) fn beside(&self, index: usize, name: &str) -> Option<usize> {
        let base = name.rsplit(['/', '\\']).next().filter(|base| !base.is_empty())?;
        let folder = |index: usize| {
            let path = self.path(index)?;
            Some(path.rsplit_once('/').map_or_else(String::new, |(folder, _)| folder.to_owned()))
        };
        let here = folder(index)?;
        let found = |same: &dyn Fn(&str) -> bool| -> Vec<usize> {
            (0..self.len()).filter(|at| *at != index && self.name(*at).is_some_and(|n| same(&n))).collect()
        };
        let exact = found(&|n| n == base);
        let alike = found(&|n| n.eq_ignore_ascii_case(base));
        [exact, alike].into_iter().find_map(|found| {
            let beside = found.iter().copied().find(|at| folder(*at).is_some_and(|f| f == here));
            beside.or(if let [only] = found.as_slice() { Some(*only) } else { None })
        })
    }

    /// The file's name without its last ending, and without `.gz` before that.
    pub(super) fn stem(&self, index: usize) -> Option<String> {
        let name = self.name(index)?;
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        Some(name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned())
    }

    /// The file's bytes; an error when there are more than `at_most`, or not as many as the archive states.
    pub(super) fn read(&mut self, index: usize, at_most: u64) -> Result<Vec<u8>, ImportError> {
        let number = index.saturating_add(1);
        let file = self.zip.by_index(index).map_err(|e| fault(&e))?;
        let size = file.size();
        if size > at_most {
            let detail = format!("file {number} of the archive has {size} bytes, but at most {at_most} are allowed");
            return Err(malformed(FORMAT, detail));
        }
        let mut bytes = Vec::new();
        let read = file.take(size.saturating_add(1)).read_to_end(&mut bytes);
        if read.is_err() || bytes.len() as u64 != size {
            return Err(malformed(FORMAT, format!("file {number} of the archive is damaged")));
        }
        Ok(bytes)
    }

    /// Up to the first `length` bytes of a file.
    pub(super) fn beginning(&mut self, index: usize, length: u64) -> Result<Vec<u8>, ImportError> {
        let file = self.zip.by_index(index).map_err(|e| fault(&e))?;
        let mut bytes = Vec::new();
        let read = file.take(length).read_to_end(&mut bytes);
        read.map_err(|_| malformed(FORMAT, format!("file {} of the archive is damaged", index.saturating_add(1))))?;
        Ok(bytes)
    }
}

/// Describes the error without file names, which may hold a patient's name.
#[expect(clippy::wildcard_enum_match_arm, reason = "the crate's errors may grow; all others are damage")]
fn fault(error: &ZipError) -> ImportError {
    let detail = match error {
        ZipError::UnsupportedArchive(ZipError::PASSWORD_REQUIRED) | ZipError::InvalidPassword => {
            "the archive is encrypted"
        }
        ZipError::UnsupportedArchive(_) | ZipError::CompressionMethodNotSupported(_) => {
            "the archive uses an unsupported compression; supported are stored and deflated files"
        }
        _ => "the archive is damaged or cut off",
    };
    malformed(FORMAT, detail)
}
