//! Datasets in chunks, which compressed ones always are.

use std::io::Read;

use super::reader::{MAX_BLOCKS, Reader};

/// A filter by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Filter(pub(super) u16);

impl Filter {
    const DEFLATE: Self = Self(1);
    const SHUFFLE: Self = Self(2);
    const FLETCHER_32: Self = Self(3);
}

/// How the chunks of a dataset of one dimension are stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chunks<'f> {
    /// Bytes of a chunk.
    pub(super) length: usize,
    /// Bytes of a value.
    pub(super) value_size: u64,
    pub(super) filters: &'f [Filter],
}

impl Chunks<'_> {
    /// The `whole` bytes of the dataset whose chunks the tree at `address` lists; bytes of missing chunks are zero.
    pub(super) fn read(&self, file: &mut Reader<'_>, address: u64, whole: usize) -> Option<Vec<u8>> {
        let mut data = vec![0; whole];
        let mut waiting = vec![address];
        while let Some(address) = waiting.pop() {
            let mut node = file.block(address)?;
            node.magic(b"TREE\x01")?;
            let (level, entries) = (node.u8()?, node.u16()?);
            let _ = (node.offset()?, node.offset()?);
            for _ in 0..entries {
                let (stored, mask) = (node.u32()?, node.u32()?);
                let (first, _, child) = (node.uint(8)?, node.uint(8)?, node.offset()?);
                if level > 0 {
                    waiting.push(child);
                    (waiting.len() <= MAX_BLOCKS).then_some(())?;
                    continue;
                }
                let chunk = self.unpack(file.slice(child, u64::from(stored))?, mask)?;
                let from = usize::try_from(first.checked_mul(self.value_size)?).ok()?;
                let part = data.get_mut(from..)?;
                let n = part.len().min(chunk.len());
                part.get_mut(..n)?.copy_from_slice(chunk.get(..n)?);
            }
        }
        Some(data)
    }

    /// Undoes the filters, the last one first; `mask` has the bit of each that was left out.
    fn unpack(&self, stored: &[u8], mask: u32) -> Option<Vec<u8>> {
        let mut bytes = stored.to_vec();
        for (place, filter) in self.filters.iter().enumerate().rev() {
            if mask.checked_shr(u32::try_from(place).ok()?).is_some_and(|m| m & 1 == 1) {
                continue;
            }
            bytes = match *filter {
                Filter::DEFLATE => {
                    let mut unpacked = Vec::new();
                    let most = u64::try_from(self.length).ok()?.checked_add(16)?;
                    flate2::read::ZlibDecoder::new(bytes.as_slice()).take(most).read_to_end(&mut unpacked).ok()?;
                    unpacked
                }
                Filter::SHUFFLE => unshuffle(&bytes, usize::try_from(self.value_size).ok()?),
                Filter::FLETCHER_32 => bytes.get(..bytes.len().checked_sub(4)?)?.to_vec(),
                _ => return None,
            };
        }
        (bytes.len() == self.length).then_some(bytes)
    }
}

/// Puts the bytes of each value together again: first come the first bytes of all values, then the second ones.
fn unshuffle(bytes: &[u8], size: usize) -> Vec<u8> {
    let count = bytes.len().checked_div(size).unwrap_or(0);
    let at = |value: usize, byte: usize| bytes.get(byte.checked_mul(count)?.checked_add(value)?).copied();
    (0..count).flat_map(|value| (0..size).map(move |byte| (value, byte))).filter_map(|(v, b)| at(v, b)).collect()
}
