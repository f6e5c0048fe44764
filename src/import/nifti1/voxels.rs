//! Stored numbers to Hounsfield units.

use std::io::Read;

use nifti::{Endianness, NiftiHeader};

use super::super::ImportError;
use super::super::error::malformed;
use super::{FORMAT, unreadable};

/// Type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    U8,
    I8,
    I16,
    U16,
    I32,
    F32,
    F64,
}

impl Kind {
    /// The header's type, if it is one that a CT can have.
    pub(super) fn of(header: &NiftiHeader) -> Result<Self, ImportError> {
        let kind = match header.datatype {
            2 => Self::U8,
            4 => Self::I16,
            8 => Self::I32,
            16 => Self::F32,
            64 => Self::F64,
            256 => Self::I8,
            512 => Self::U16,
            code => {
                let read = "2, 4, 8, 16, 64, 256, 512 (8 to 32 bit integers and floats)";
                return Err(malformed(FORMAT, format!("the voxels have the data type {code}, expected {read}")));
            }
        };
        let bits = i64::from(header.bitpix);
        if bits != (kind.size() as i64).saturating_mul(8) {
            let detail = format!("{bits} bits a voxel, which do not fit the data type {}", header.datatype);
            return Err(malformed(FORMAT, detail));
        }
        Ok(kind)
    }

    /// Bytes of a number.
    pub(super) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// Reads `n_voxels` numbers, scales them by the header's slope and intercept, rounds, and clamps to `i16`.
///
/// A slope of zero or NaN means that nothing is scaled. The caller has checked `n_voxels` against limits and length.
pub(super) fn read(
    stream: &mut dyn Read,
    header: &NiftiHeader,
    kind: Kind,
    n_voxels: usize,
    warnings: &mut Vec<String>,
) -> Result<Vec<i16>, ImportError> {
    let [slope, intercept] = [header.scl_slope, header.scl_inter].map(f64::from);
    let unscaled = slope == 0.0 || slope.is_nan();
    if !(unscaled || slope.is_finite() && intercept.is_finite()) {
        return Err(malformed(FORMAT, format!("slope {slope:?} and intercept {intercept:?}, expected finite numbers")));
    }
    let mut scale = Scale { slope, intercept, unscaled, n_nan: 0, n_clamped: 0, min: i16::MAX };
    let little = header.endianness == Endianness::Little;

    // Not allocated at once: a crafted gzip file states more than it holds.
    let mut hu = Vec::new();
    let mut buffer = vec![0u8; 1 << 18];
    while hu.len() < n_voxels {
        let left = n_voxels.saturating_sub(hu.len()).saturating_mul(kind.size());
        let length = left.min(buffer.len());
        let chunk = buffer.get_mut(..length).unwrap_or_default();
        stream.read_exact(chunk).map_err(|e| unreadable(&e))?;
        macro_rules! convert {
            ($number:ty) => {{
                let (numbers, _) = chunk.as_chunks();
                hu.extend(numbers.iter().map(|b| {
                    scale.apply(f64::from(if little {
                        <$number>::from_le_bytes(*b)
                    } else {
                        <$number>::from_be_bytes(*b)
                    }))
                }));
            }};
        }
        match kind {
            Kind::U8 => convert!(u8),
            Kind::I8 => convert!(i8),
            Kind::I16 => convert!(i16),
            Kind::U16 => convert!(u16),
            Kind::I32 => convert!(i32),
            Kind::F32 => convert!(f32),
            Kind::F64 => convert!(f64),
        }
    }
    hu.shrink_to_fit();
    scale.report(warnings);
    Ok(hu)
}

struct Scale {
    slope: f64,
    intercept: f64,
    unscaled: bool,
    n_nan: u64,
    n_clamped: u64,
    min: i16,
}

impl Scale {
    /// Air, for voxels without a value.
    const AIR: i16 = -1024;

    fn apply(&mut self, stored: f64) -> i16 {
        let value = if self.unscaled { stored } else { self.slope * stored + self.intercept };
        let hu = if value.is_nan() {
            self.n_nan = self.n_nan.saturating_add(1);
            Self::AIR
        } else {
            let rounded = value.round();
            let clamped = rounded.clamp(f64::from(i16::MIN), f64::from(i16::MAX));
            self.n_clamped = self.n_clamped.saturating_add(u64::from(clamped != rounded));
            clamped as i16
        };
        self.min = self.min.min(hu);
        hu
    }

    fn report(&self, warnings: &mut Vec<String>) {
        if self.n_nan > 0 {
            warnings.push(format!("{} voxels without a value (NaN) were set to {} HU", self.n_nan, Self::AIR));
        }
        if self.n_clamped > 0 {
            warnings.push(format!("{} voxels beyond -32768 to 32767 HU were clamped", self.n_clamped));
        }
        if self.min > -200 {
            let min = self.min;
            warnings.push(format!("the smallest value is {min}, but air has -1000 HU: are these Hounsfield units?"));
        }
    }
}
