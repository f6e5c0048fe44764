use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::ExportError;
use prosopon_geometry::Volume;

/// Bytes of the header (348) and of the mark that no extension follows (4).
const HEADER: usize = 352;

/// NIfTI-1 in one gzipped file, with HU as `i16` and the lattice as sform in RAS mm.
///
/// Oblique and sheared lattices are kept. The header holds nothing else. The lattice is rounded to `f32`, about 1e-5 mm on
/// a head.
///
/// # Errors
/// [`ExportError::TooManyVoxels`] when a dimension exceeds 32767, the largest that the format stores.
pub fn nifti_gz(volume: &Volume) -> Result<Vec<u8>, ExportError> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&header(volume)?)?;
    for values in volume.hu.chunks(1 << 16) {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        packed.write_all(&bytes)?;
    }
    Ok(packed.finish()?)
}

/// The header, with fields at their offsets in `nifti1.h`.
fn header(volume: &Volume) -> Result<Vec<u8>, ExportError> {
    let mut bytes = vec![0u8; HEADER];
    let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
    put(0, &348i32.to_le_bytes());
    let dims = [3, volume.dims[0], volume.dims[1], volume.dims[2], 1, 1, 1, 1];
    for (index, dim) in dims.into_iter().enumerate() {
        let dim =
            i16::try_from(dim).map_err(|_| ExportError::TooManyVoxels { dims: volume.dims, allowed: i16::MAX })?;
        put(40 + 2 * index, &dim.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    for (axis, step) in volume.axes.iter().enumerate() {
        put(80 + 4 * axis, &(step.norm() as f32).to_le_bytes());
    }
    put(108, &(HEADER as f32).to_le_bytes());
    put(112, &1f32.to_le_bytes());
    // The unit of length is mm.
    put(123, &[2]);
    // The sform gives coordinates of the scanner.
    put(254, &1i16.to_le_bytes());
    for row in 0..3 {
        let sign = if row < 2 { -1.0 } else { 1.0 };
        let [i, j, k] = volume.axes.map(|axis| axis[row]);
        for (column, value) in [i, j, k, volume.origin[row]].into_iter().enumerate() {
            put(280 + 16 * row + 4 * column, &((sign * value) as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Limits, volume};
    use prosopon_geometry::{Point, Vector};

    #[test]
    fn a_sheared_oblique_volume_comes_back() {
        let axes = [Vector::new(0.5, 0.25, 0.0), Vector::new(-0.25, 0.5, 0.125), Vector::new(0.5, -1.0, 2.0)];
        let hu = (0..40 * 30 * 20).map(|i| (i % 4000 - 1024) as i16).collect();
        let written = Volume { dims: [40, 30, 20], origin: Point::new(-7.5, 3.25, 11.0), axes, hu };
        let (read, warnings) = volume(&nifti_gz(&written).unwrap(), &Limits::default()).unwrap();
        assert_eq!(warnings, []);
        // All of these numbers are multiples of an eighth, which `f32` holds exactly.
        assert_eq!(read, written);
    }

    #[test]
    fn a_dimension_that_the_format_cannot_store_is_refused() {
        let axes = [Vector::x(), Vector::y(), Vector::z()];
        let mut long = Volume { dims: [32_767, 1, 1], origin: Point::origin(), axes, hu: vec![0; 32_767] };
        assert!(nifti_gz(&long).is_ok());
        long.dims[0] += 1;
        long.hu.push(0);
        assert!(matches!(nifti_gz(&long), Err(ExportError::TooManyVoxels { dims: [32_768, 1, 1], .. })));
    }
}
