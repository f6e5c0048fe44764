use super::StoreError;
use prosopon_geometry::{Point, TriMesh};

const MAGIC: &[u8; 8] = b"PRMESH01";

/// Encodes a surface bit for bit, so that fields and meshes rebuilt from it are identical.
///
/// Layout, little-endian: magic, numbers of vertices and triangles (u64), positions (f64 x, y, z; LPS mm), corners (u32).
#[must_use]
pub fn encode_mesh(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(24 + 24 * mesh.positions().len() + 12 * mesh.triangles().len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&(mesh.positions().len() as u64).to_le_bytes());
    bytes.extend_from_slice(&(mesh.triangles().len() as u64).to_le_bytes());
    for position in mesh.positions() {
        for coordinate in position.iter() {
            bytes.extend_from_slice(&coordinate.to_le_bytes());
        }
    }
    for corner in mesh.triangles().iter().flatten() {
        bytes.extend_from_slice(&corner.to_le_bytes());
    }
    bytes
}

/// Reads what [`encode_mesh`] wrote.
///
/// # Errors
/// [`StoreError::Record`] when the bytes have another layout or do not form a mesh.
pub fn decode_mesh(bytes: &[u8]) -> Result<TriMesh, StoreError> {
    let bad = |what: &str| StoreError::record(format!("stored surface: {what}"));
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or_else(|| bad("too short"))?;
    if magic != MAGIC {
        return Err(bad("wrong magic"));
    }
    let (n_vertices, rest) = rest.split_first_chunk::<8>().ok_or_else(|| bad("too short"))?;
    let (n_triangles, rest) = rest.split_first_chunk::<8>().ok_or_else(|| bad("too short"))?;
    let n_vertices = u64::from_le_bytes(*n_vertices) as usize;
    let n_triangles = u64::from_le_bytes(*n_triangles) as usize;
    let position_bytes = n_vertices.checked_mul(24).ok_or_else(|| bad("impossible number of vertices"))?;
    let corner_bytes = n_triangles.checked_mul(12).ok_or_else(|| bad("impossible number of triangles"))?;
    if position_bytes.checked_add(corner_bytes) != Some(rest.len()) {
        return Err(bad("the length does not match the numbers of vertices and triangles"));
    }
    let (positions, corners) = rest.split_at(position_bytes);
    let number = |b: &[u8; 8]| f64::from_le_bytes(*b);
    let positions = positions.as_chunks::<8>().0.as_chunks::<3>().0;
    let positions = positions.iter().map(|[x, y, z]| Point::new(number(x), number(y), number(z))).collect();
    let corners = corners.as_chunks::<4>().0.as_chunks::<3>().0;
    let triangles = corners.iter().map(|t| t.map(u32::from_le_bytes)).collect();
    TriMesh::new(positions, triangles).map_err(|e| bad(&e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_comes_back_bit_for_bit_and_faults_are_refused() {
        let positions = vec![Point::new(0.1, -2.0, 1e-300), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [2, 1, 0]]).unwrap();
        let bytes = encode_mesh(&mesh);
        assert_eq!(decode_mesh(&bytes).unwrap(), mesh);
        for length in 0..bytes.len() {
            assert!(decode_mesh(&bytes[..length]).is_err());
        }
        let mut huge = bytes;
        huge[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(decode_mesh(&huge).is_err());
    }
}
