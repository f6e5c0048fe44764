//! Type and scale of the stored numbers.

use nifti::NiftiHeader;

use super::super::ImportError;
use super::super::error::malformed;
use super::super::number::NumberType;
use super::FORMAT;

/// The number type in the header; an error for types that a CT cannot have.
pub(super) fn number_type_of(header: &NiftiHeader) -> Result<NumberType, ImportError> {
    let number_type = match header.datatype {
        2 => NumberType::U8,
        4 => NumberType::I16,
        8 => NumberType::I32,
        16 => NumberType::F32,
        64 => NumberType::F64,
        256 => NumberType::I8,
        512 => NumberType::U16,
        768 => NumberType::U32,
        1024 => NumberType::I64,
        1280 => NumberType::U64,
        code => {
            let kind = match code {
                1 => " (bits)",
                32 | 1792 | 2048 => " (complex numbers)",
                128 | 2304 => " (colours)",
                1536 => " (floats of 128 bits)",
                _ => "",
            };
            let read = "2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280 (integers and floats of 8 to 64 bits)";
            return Err(malformed(FORMAT, format!("the voxels have the data type {code}{kind}, expected {read}")));
        }
    };
    let bits = i64::from(header.bitpix);
    if bits != (number_type.size() as i64).saturating_mul(8) {
        let detail = format!("{bits} bits a voxel, which do not match the data type {}", header.datatype);
        return Err(malformed(FORMAT, detail));
    }
    Ok(number_type)
}

/// The slope and intercept in the header; a slope of zero or NaN means no scaling.
pub(super) fn scale_of(header: &NiftiHeader) -> Result<(f64, f64), ImportError> {
    let [slope, intercept] = [header.scl_slope, header.scl_inter].map(f64::from);
    if slope == 0.0 || slope.is_nan() {
        return Ok((1.0, 0.0));
    }
    if !(slope.is_finite() && intercept.is_finite()) {
        return Err(malformed(FORMAT, format!("slope {slope:?} and intercept {intercept:?}, expected finite numbers")));
    }
    Ok((slope, intercept))
}
