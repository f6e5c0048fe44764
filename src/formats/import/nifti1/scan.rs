//! Checks a NIfTI file while it arrives.

use std::io::{ErrorKind, Write};

use flate2::write::MultiGzDecoder;

use super::{FORMAT, GZIP, HEADER, check_header, read_header, unreadable};
use crate::import::error::malformed;
use crate::import::{ImportError, Limits};

/// Takes a file in pieces and checks its header and length; unpacks a gzipped file without keeping it.
#[derive(Debug)]
pub(in crate::import) struct Scan {
    limits: Limits,
    unpacker: Option<MultiGzDecoder<Count>>,
    /// Counts the bytes of a file that is not gzipped.
    plain: Count,
}

/// Compressed bytes between two checks of the unpacked length: a crafted file expands a thousandfold.
const PIECE: usize = 1 << 14;

/// The header's bytes, the number of unpacked bytes so far, and the number that the header demands.
#[derive(Debug, Default)]
struct Count {
    header: Vec<u8>,
    bytes: u64,
    needed: Option<u64>,
}

impl Write for Count {
    fn write(&mut self, piece: &[u8]) -> std::io::Result<usize> {
        let lacking = (HEADER as usize).saturating_sub(self.header.len());
        self.header.extend(piece.iter().take(lacking));
        self.bytes = self.bytes.saturating_add(piece.len() as u64);
        Ok(piece.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Count {
    /// Whether there are bytes after the voxels, which are not read.
    fn is_over(&self) -> bool {
        self.needed.is_some_and(|needed| self.bytes > needed)
    }

    /// Reads the header once it is complete. The length of the file is not known yet.
    fn look(&mut self, limits: &Limits) -> Result<(), ImportError> {
        if self.needed.is_none() && self.header.len() as u64 == HEADER {
            let header = read_header(&mut self.header.as_slice())?;
            self.needed = Some(check_header(header, HEADER, u64::MAX, limits, &mut Vec::new())?.end);
        }
        Ok(())
    }
}

impl Scan {
    /// A scan of a file that begins with `beginning`; the caller must still pass these bytes to [`Scan::push`].
    pub(in crate::import) fn new(beginning: &[u8], limits: Limits) -> Self {
        let unpacker = beginning.starts_with(&GZIP).then(|| MultiGzDecoder::new(Count::default()));
        Self { limits, unpacker, plain: Count::default() }
    }

    fn count(&mut self) -> &mut Count {
        self.unpacker.as_mut().map_or(&mut self.plain, MultiGzDecoder::get_mut)
    }

    /// Takes the next piece. Refuses the header of a volume that is not a CT as soon as it is complete.
    pub(in crate::import) fn push(&mut self, piece: &[u8]) -> Result<(), ImportError> {
        if self.count().is_over() {
            return Ok(());
        }
        let limits = self.limits;
        for part in piece.chunks(PIECE) {
            let taken = match &mut self.unpacker {
                Some(unpacker) => unpacker.write_all(part),
                None => self.plain.write_all(part),
            };
            self.count().look(&limits)?;
            if self.count().is_over() {
                return Ok(());
            }
            taken.map_err(|e| unreadable(&e))?;
        }
        Ok(())
    }

    /// Ends the scan: checks that all voxels arrived, and the checksums of a gzipped file.
    pub(in crate::import) fn finish(mut self) -> Result<(), ImportError> {
        let limits = self.limits;
        // Also writes the bytes that the unpacker still buffered.
        let ended = match &mut self.unpacker {
            Some(unpacker) if !unpacker.get_ref().is_over() => unpacker.try_finish(),
            _ => Ok(()),
        };
        let count = self.count();
        count.look(&limits)?;
        match count.needed {
            Some(needed) if count.bytes < needed => {
                let detail = format!("cut off: the last voxel ends at byte {needed}, but there are {}", count.bytes);
                Err(malformed(FORMAT, detail))
            }
            Some(_) => ended.map_err(|e| unreadable(&e)),
            None => Err(unreadable(&ErrorKind::UnexpectedEof.into())),
        }
    }
}
