//! Files that are measured while they are read.

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::Path;

use sha2::{Digest, Sha256};

use super::records::hex;
use super::seal;

/// What was measured while a file was read.
#[derive(Debug, PartialEq)]
pub(super) struct Measured {
    pub(super) sha256: String,
    pub(super) bytes: u64,
    /// Whether the content matches its seal.
    pub(super) is_whole: bool,
    /// Whether it has the seal of a value that is not encrypted, or none.
    pub(super) is_plain: bool,
}

/// Copies a file and syncs the copy.
pub(super) fn copy(from: &Path, to: &Path, key: &str) -> io::Result<Measured> {
    let (mut from, mut to) = (File::open(from)?, File::create(to)?);
    let found = each_piece(&mut from, key, |piece| to.write_all(piece))?;
    to.sync_all()?;
    Ok(found)
}

/// Reads a file through.
pub(super) fn read(path: &Path, key: &str) -> io::Result<Measured> {
    each_piece(&mut File::open(path)?, key, |_| Ok(()))
}

fn each_piece(file: &mut File, key: &str, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<Measured> {
    let (mut hash, mut check, mut bytes, mut piece) = (Sha256::new(), seal::Check::new(), 0, vec![0; 1 << 20]);
    loop {
        let n = file.read(&mut piece)?;
        if n == 0 {
            let found = check.finds(key);
            let (is_whole, is_plain) = (found.is_some(), found == Some(None));
            return Ok(Measured { sha256: hex(&hash.finalize()), bytes, is_whole, is_plain });
        }
        let piece = piece.get(..n).unwrap_or_default();
        hash.update(piece);
        check.read(piece);
        bytes += n as u64;
        take(piece)?;
    }
}
