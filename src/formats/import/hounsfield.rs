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

/// Reads `n_voxels` numbers as HU. The caller has checked `n_voxels` against the limits and the length of the file.
///
/// # Errors
/// The error that `unreadable` makes when the stream ends early or is damaged.
pub(super) fn read(
    stream: &mut dyn Read,
    numbers: NumberFormat,
    n_voxels: usize,
    mut scale: Scale,
    warnings: &mut Vec<Warning>,
    unreadable: impl Fn(&std::io::Error) -> ImportError,
) -> Result<Vec<i16>, ImportError> {
    // Grows with the data: a crafted compressed file may state more voxels than it holds.
    let mut hu = Vec::new();
    let mut buffer = vec![0u8; 1 << 18];
    while hu.len() < n_voxels {
        let left = n_voxels.saturating_sub(hu.len()).saturating_mul(numbers.number_type.size());
        let length = left.min(buffer.len());
        let chunk = buffer.get_mut(..length).unwrap_or_default();
        stream.read_exact(chunk).map_err(|e| unreadable(&e))?;
        numbers.number_type.each(chunk, numbers.byte_order, &mut |stored| hu.push(scale.apply(stored)));
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

/// Reads the `n_voxels` HU in `data`; warns of bytes after them and ignores these.
///
/// # Errors
/// [`ImportError::Malformed`] of `format` when `data` is too short or damaged. Data that are too short are refused before
/// anything is allocated.
pub(super) fn read_whole(
    format: &'static str,
    data: &[u8],
    packing: Packing,
    numbers: NumberFormat,
    n_voxels: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<i16>, ImportError> {
    let mut stream: Box<dyn Read + '_> = match packing {
        Packing::Plain => Box::new(data),
        Packing::Zlib => Box::new(ZlibDecoder::new(data)),
        Packing::Gzip => Box::new(MultiGzDecoder::new(data)),
    };
    let needed = (n_voxels as u64).saturating_mul(numbers.number_type.size() as u64);
    if needed > packing.max_unpacked(data.len() as u64) {
        let detail =
            format!("{n_voxels} voxels need {needed} bytes, more than the {} bytes of data can hold", data.len());
        return Err(malformed(format, detail));
    }
    let unreadable = |error: &std::io::Error| {
        let cut_off = error.kind() == ErrorKind::UnexpectedEof;
        malformed(format, if cut_off { "the voxels are cut off" } else { "the compressed voxels are damaged" })
    };
    let hu = read(&mut stream, numbers, n_voxels, Scale::new(1.0, 0.0), warnings, unreadable)?;
    if stream.read(&mut [0]).map_err(|e| unreadable(&e))? > 0 {
        warnings.push(bytes_after_voxels());
    }
    Ok(hu)
}
