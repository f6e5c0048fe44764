use super::StoreError;
use prosopon_geometry::{Point, ScalarGrid};

const MAGIC: &[u8; 8] = b"PRGRID01";
/// Stands for NaN.
const NOTHING: i8 = i8::MIN;

/// Encodes a grid of whole values from -127 to 127; other values are rounded and clamped, NaN is kept.
///
/// Layout, little-endian: magic, dimensions (u64), origin and spacing (f64, mm), values (i8) in the order of the grid.
#[must_use]
pub fn encode_grid(grid: &ScalarGrid) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(64 + grid.values.len());
    bytes.extend_from_slice(MAGIC);
    grid.dims.iter().for_each(|d| bytes.extend_from_slice(&(*d as u64).to_le_bytes()));
    grid.origin.iter().chain([&grid.spacing]).for_each(|c| bytes.extend_from_slice(&c.to_le_bytes()));
    let byte = |v: &f32| if v.is_nan() { NOTHING } else { v.round().clamp(-127.0, 127.0) as i8 };
    bytes.extend(grid.values.iter().map(|v| byte(v) as u8));
    bytes
}

/// Reads what [`encode_grid`] wrote.
///
/// # Errors
/// [`StoreError::Record`] when the bytes have another layout.
pub fn decode_grid(bytes: &[u8]) -> Result<ScalarGrid, StoreError> {
    let bad = |what: &str| StoreError::record(format!("stored grid: {what}"));
    let (head, values) = bytes.split_at_checked(64).ok_or_else(|| bad("too short"))?;
    let [magic, nx, ny, nz, x, y, z, spacing] = *head.as_chunks::<8>().0 else { return Err(bad("too short")) };
    if &magic != MAGIC {
        return Err(bad("wrong magic"));
    }
    let dims = [nx, ny, nz].map(|d| u64::from_le_bytes(d) as usize);
    let count = dims.iter().try_fold(1_usize, |product, d| product.checked_mul(*d));
    if dims.iter().any(|d| *d < 2) || count != Some(values.len()) {
        return Err(bad("the length does not match the dimensions"));
    }
    let [x, y, z, spacing] = [x, y, z, spacing].map(f64::from_le_bytes);
    let value = |b: &u8| if *b as i8 == NOTHING { f32::NAN } else { f32::from(*b as i8) };
    Ok(ScalarGrid { dims, origin: Point::new(x, y, z), spacing, values: values.iter().map(value).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lattice_comes_back_and_faults_are_refused() {
        let values = vec![-127.0, 127.0, 0.0, 3.0, -90.0, 55.0, 1.0, 2.0];
        let grid = ScalarGrid { dims: [2, 2, 2], origin: Point::new(-1.5, 0.1, 7.0), spacing: 2.2, values };
        let bytes = encode_grid(&grid);
        assert_eq!(decode_grid(&bytes).unwrap(), grid);
        let holed = ScalarGrid { values: vec![f32::NAN; 8], ..grid };
        assert!(decode_grid(&encode_grid(&holed)).unwrap().values.iter().all(|v| v.is_nan()));
        assert!(decode_grid(&bytes[..70]).is_err() && decode_grid(&[]).is_err());
        let mut huge = bytes.clone();
        huge[8..32].fill(0xff);
        assert!(decode_grid(&huge).is_err());
    }
}
