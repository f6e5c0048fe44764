//! Converts stored numbers to Hounsfield units.

use std::io::{ErrorKind, Read};

use flate2::read::{MultiGzDecoder, ZlibDecoder};

use super::ImportError;
use super::error::malformed;
use super::number::NumberFormat;
use prosopon_geometry::Warning;

/// Value of voxels without a measurement, HU: that of air.
pub(super) const AIR: i16 = -1024;

/// Scales stored numbers, rounds and clamps them to `i16`, and counts the changes.
#[derive(Debug, Clone)]
pub(super) struct Scale {
    slope: f64,
    intercept: f64,
    n_nan: u64,
    n_clamped: u64,
    min: i16,
}

impl Scale {
    /// HU = `slope` × stored + `intercept`; both are finite.
    pub(super) fn new(slope: f64, intercept: f64) -> Self {
        Self { slope, intercept, n_nan: 0, n_clamped: 0, min: i16::MAX }
    }

    /// The HU of a stored number.
    pub(super) fn apply(&mut self, stored: f64) -> i16 {
        let value = self.slope * stored + self.intercept;
        let hu = if value.is_nan() {
            self.n_nan = self.n_nan.saturating_add(1);
            AIR
        } else {
            let rounded = value.round();
            let clamped = rounded.clamp(f64::from(i16::MIN), f64::from(i16::MAX));
            self.n_clamped = self.n_clamped.saturating_add(u64::from(clamped != rounded));
            clamped as i16
        };
        self.min = self.min.min(hu);
        hu
    }

    /// Adds the counts of `other`.
    pub(super) fn join(&mut self, other: &Self) {
        self.n_nan = self.n_nan.saturating_add(other.n_nan);
        self.n_clamped = self.n_clamped.saturating_add(other.n_clamped);
        self.min = self.min.min(other.min);
    }

    /// Warns of changed values and of values that are probably not HU.
    pub(super) fn report(&self, warnings: &mut Vec<Warning>) {
        if self.n_nan > 0 {
            let found = format!("{} voxels without a value (NaN) were set to {AIR} HU", self.n_nan);
            warnings.push(
                Warning::check("voxels-without-value", found).act("Check that these voxels lie outside the head."),
            );
        }
        if self.n_clamped > 0 {
            let found = format!("{} voxels beyond -32768 to 32767 HU were clamped", self.n_clamped);
            warnings.push(Warning::check("clamped-voxels", found).act("Check the scale of the values in the file."));
        }
        if self.min > -200 {
            let found = format!("the smallest value is {}, but air has -1000 HU", self.min);
            warnings.push(Warning::check("no-air", found).act("Check that the values are Hounsfield units."));
        }
    }
}

/// Which numbers of a file make the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Selection {
    /// Numbers of the volume.
    n: usize,
    /// Numbers before its first.
    skip: usize,
    /// Distance between its numbers; 1 when they follow one another.
    stride: usize,
    /// Numbers in the file.
    total: usize,
}

impl Selection {
    /// All `n` numbers.
    pub(super) fn whole(n: usize) -> Self {
        Self { n, skip: 0, stride: 1, total: n }
    }

    /// Volume `index` of `count` that follow one another, of `n` numbers each.
    pub(super) fn following(n: usize, index: usize, count: usize) -> Self {
        Self { n, skip: n.saturating_mul(index), stride: 1, total: n.saturating_mul(count) }
    }

    /// Number `index` of the `count` numbers of each of `n` voxels.
    pub(super) fn interleaved(n: usize, index: usize, count: usize) -> Self {
        Self { n, skip: index, stride: count, total: n.saturating_mul(count) }
    }

    /// Numbers up to the last of the volume.
    fn end(&self) -> usize {
        self.n.saturating_sub(1).saturating_mul(self.stride).saturating_add(self.skip).saturating_add(1)
    }

    /// Numbers in the file.
    pub(super) fn total(&self) -> usize {
        self.total
    }
}

/// Numbers that make the volume, and their scale.
#[derive(Debug, Clone)]
pub(super) struct Voxels {
    pub(super) numbers: NumberFormat,
    pub(super) selection: Selection,
    pub(super) scale: Scale,
}

impl Voxels {
    /// Bytes of all numbers in the file.
    pub(super) fn bytes(&self) -> u64 {
        (self.selection.total as u64).saturating_mul(self.numbers.number_type.size() as u64)
    }
}

/// Reads the volume as HU, and the file's other numbers to their end. The caller has checked the number of voxels against the
/// limits, and that of numbers against the length of the file.
///
/// # Errors
/// The error that `unreadable` makes when the stream ends early or is damaged.
pub(super) fn read(
    stream: &mut dyn Read,
    voxels: Voxels,
    warnings: &mut Vec<Warning>,
    unreadable: impl Fn(&std::io::Error) -> ImportError,
) -> Result<Vec<i16>, ImportError> {
    let Voxels { numbers, selection, mut scale } = voxels;
    let size = numbers.number_type.size();
    // Grows with the data: a crafted compressed file may state more voxels than it holds.
    let mut hu = Vec::new();
    let mut buffer = vec![0u8; 1 << 18];
    let mut left = selection.end().saturating_mul(size);
    let mut until_next = selection.skip;
    while left > 0 {
        let length = left.min(buffer.len());
        let chunk = buffer.get_mut(..length).unwrap_or_default();
        stream.read_exact(chunk).map_err(|e| unreadable(&e))?;
        numbers.number_type.each(chunk, numbers.byte_order, &mut |stored| {
            if until_next == 0 {
                hu.push(scale.apply(stored));
                until_next = selection.stride;
            }
            until_next = until_next.saturating_sub(1);
        });
        left = left.saturating_sub(length);
    }
    let rest = selection.total.saturating_sub(selection.end()).saturating_mul(size) as u64;
    if std::io::copy(&mut stream.take(rest), &mut std::io::sink()).map_err(|e| unreadable(&e))? < rest {
        return Err(unreadable(&ErrorKind::UnexpectedEof.into()));
    }
    hu.shrink_to_fit();
    scale.report(warnings);
    Ok(hu)
}

/// Compression of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Plain,
    Zlib,
    Gzip,
}

/// Largest number of bytes to which one byte of a deflate stream can expand.
const MAX_INFLATION: u64 = 1032;

impl Packing {
    /// Most bytes that `length` packed bytes can hold.
    pub(super) fn max_unpacked(self, length: u64) -> u64 {
        match self {
            Self::Plain => length,
            Self::Zlib | Self::Gzip => length.saturating_mul(MAX_INFLATION),
        }
    }
}

/// Warns that bytes follow the last voxel.
pub(super) fn bytes_after_voxels() -> Warning {
    Warning::check("bytes-after-voxels", "bytes after the last voxel were ignored")
        .act("Check that the dimensions in the header are those of the image.")
}

/// Reads the volume in `data`; warns of bytes after its numbers and ignores these.
///
/// # Errors
/// [`ImportError::Malformed`] of `format` when `data` is too short or damaged. Data that are too short are refused before
/// anything is allocated.
pub(super) fn read_whole(
    format: &'static str,
    data: &[u8],
    packing: Packing,
    voxels: Voxels,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<i16>, ImportError> {
    let mut stream: Box<dyn Read + '_> = match packing {
        Packing::Plain => Box::new(data),
        Packing::Zlib => Box::new(ZlibDecoder::new(data)),
        Packing::Gzip => Box::new(MultiGzDecoder::new(data)),
    };
    let needed = voxels.bytes();
    if needed > packing.max_unpacked(data.len() as u64) {
        let n = voxels.selection.total();
        let detail = format!("{n} voxels need {needed} bytes, more than the {} bytes of data can hold", data.len());
        return Err(malformed(format, detail));
    }
    let unreadable = |error: &std::io::Error| {
        let cut_off = error.kind() == ErrorKind::UnexpectedEof;
        malformed(format, if cut_off { "the voxels are cut off" } else { "the compressed voxels are damaged" })
    };
    let hu = read(&mut stream, voxels, warnings, unreadable)?;
    if stream.read(&mut [0]).map_err(|e| unreadable(&e))? > 0 {
        warnings.push(bytes_after_voxels());
    }
    Ok(hu)
}

#[cfg(test)]
mod tests {
    use super::super::number::{ByteOrder, NumberType};
    use super::*;

    #[test]
    fn a_selection_takes_its_numbers_and_needs_all() {
        let data: Vec<u8> = (0..12i16).flat_map(i16::to_le_bytes).collect();
        let numbers = NumberFormat { number_type: NumberType::I16, byte_order: ByteOrder::Little };
        let read = |selection, data: &[u8]| {
            let voxels = Voxels { numbers, selection, scale: Scale::new(1.0, 0.0) };
            read_whole("NRRD", data, Packing::Plain, voxels, &mut Vec::new())
        };
        for (selection, expected) in [
            (Selection::whole(12), (0..12).collect::<Vec<i16>>()),
            (Selection::following(4, 1, 3), vec![4, 5, 6, 7]),
            (Selection::following(4, 2, 3), vec![8, 9, 10, 11]),
            (Selection::interleaved(4, 0, 3), vec![0, 3, 6, 9]),
            (Selection::interleaved(4, 2, 3), vec![2, 5, 8, 11]),
        ] {
            assert_eq!(read(selection, &data).unwrap(), expected, "{selection:?}");
            assert!(read(selection, &data[..23]).is_err(), "{selection:?}");
        }
    }
}
