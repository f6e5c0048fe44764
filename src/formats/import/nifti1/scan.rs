//! A file looked over while it arrives.

use std::io::{ErrorKind, Write};

use flate2::write::MultiGzDecoder;

use super::{FORMAT, GZIP, HEADER, read_layout, unreadable};
use crate::import::error::malformed;
use crate::import::{ImportError, Limits};

/// Takes a file in pieces and says whether header and length fit, unpacking a gzipped one without keeping it.
#[derive(Debug)]
pub(in crate::import) struct Scan {
    limits: Limits,
    unpacker: Option<MultiGzDecoder<Count>>,
    /// What a file that is not gzipped holds.
    plain: Count,
}

/// Bytes unpacked between two looks at how much there is: a crafted file swells a thousandfold.
const PIECE: usize = 1 << 14;

/// What came out so far: the header's bytes, how many followed, and how many are to follow.
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
    /// Whether more came than the voxels take: what follows them is not read.
    fn is_over(&self) -> bool {
        self.needed.is_some_and(|needed| self.bytes > needed)
    }

    /// Reads the header once it is there. How long the file will be is not known yet.
    fn look(&mut self, limits: &Limits) -> Result<(), ImportError> {
        if self.needed.is_none() && self.header.len() as u64 == HEADER {
            let layout = read_layout(&mut self.header.as_slice(), false, u64::MAX, limits, &mut Vec::new())?;
            self.needed = Some(layout.end);
        }
        Ok(())
    }
}

impl Scan {
    /// A scan of a file that begins with `beginning`, which is still to be given to [`Scan::push`].
    pub(in crate::import) fn new(beginning: &[u8], limits: Limits) -> Self {
        let unpacker = beginning.starts_with(&GZIP).then(|| MultiGzDecoder::new(Count::default()));
        Self { limits, unpacker, plain: Count::default() }
    }

    fn count(&mut self) -> &mut Count {
        self.unpacker.as_mut().map_or(&mut self.plain, MultiGzDecoder::get_mut)
    }

    /// Takes the next piece. A header that cannot be of a CT is refused as soon as it is there.
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

    /// Whether all voxels were there, and the sums of a gzipped file right.
    pub(in crate::import) fn finish(mut self) -> Result<(), ImportError> {
        let limits = self.limits;
        // Also hands out what the unpacker still held back.
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
