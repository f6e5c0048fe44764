use prosopon_contract::{Fault, FaultKind};
use prosopon_geometry::{Point, TriMesh};

/// Skin of one step, as stored and served; `api/frames.md` is the contract.
///
/// Layout, little-endian f32: positions x, y, z of all vertices, then the length of each vertex' displacement, then the signed
/// error of each vertex if there is one; all in mm.
#[derive(Debug, Clone, PartialEq)]
pub struct SkinFrame {
    /// Positions of the vertices, LPS mm.
    pub positions_mm: Vec<[f32; 3]>,
    /// Length of each vertex' displacement, mm.
    pub displacement_mm: Vec<f32>,
    /// Signed error of each vertex, mm; `None` when the step is compared with nothing.
    pub error_mm: Option<Vec<f32>>,
}

impl SkinFrame {
    /// The frame of `rest`, which nothing has moved.
    #[must_use]
    pub fn at_rest(rest: &TriMesh) -> Self {
        let positions_mm: Vec<[f32; 3]> =
            rest.positions().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        let displacement_mm = vec![0.0; positions_mm.len()];
        Self { positions_mm, displacement_mm, error_mm: None }
    }

    /// Encodes the frame.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let scalars = self.displacement_mm.iter().chain(self.error_mm.iter().flatten());
        self.positions_mm.iter().flatten().chain(scalars).flat_map(|v| v.to_le_bytes()).collect()
    }

    /// Decodes a frame of `n_vertices` vertices.
    ///
    /// # Errors
    /// [`FaultKind::Internal`] when the length does not match the number of vertices.
    pub fn decode(bytes: &[u8], n_vertices: usize) -> Result<Self, Fault> {
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let n_scalars = values.len().checked_sub(3 * n_vertices).filter(|_| bytes.len().is_multiple_of(4));
        let has_error = match n_scalars {
            Some(n) if n == n_vertices => false,
            Some(n) if n == 2 * n_vertices => true,
            _ => return Err(Fault::new(FaultKind::Internal, "a stored frame does not match its surface")),
        };
        let (positions, scalars) = values.split_at(3 * n_vertices);
        let (displacement, error) = scalars.split_at(n_vertices);
        Ok(Self {
            positions_mm: positions.as_chunks::<3>().0.to_vec(),
            displacement_mm: displacement.to_vec(),
            error_mm: has_error.then(|| error.to_vec()),
        })
    }

    /// The deformed skin on the triangles of the skin at rest.
    ///
    /// # Errors
    /// [`FaultKind::Internal`] when the numbers of vertices differ.
    pub fn mesh(&self, rest: &TriMesh) -> Result<TriMesh, Fault> {
        let positions = self.positions_mm.iter().map(|p| Point::from(p.map(f64::from))).collect();
        rest.with_positions(positions)
            .map_err(|_| Fault::new(FaultKind::Internal, "a stored frame does not match its surface"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_back_with_and_without_errors() {
        let mut frame = SkinFrame {
            positions_mm: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            displacement_mm: vec![0.5, 0.25],
            error_mm: None,
        };
        assert_eq!(SkinFrame::decode(&frame.encode(), 2).unwrap(), frame);
        frame.error_mm = Some(vec![-1.0, 1.0]);
        assert_eq!(SkinFrame::decode(&frame.encode(), 2).unwrap(), frame);
        assert!(SkinFrame::decode(&frame.encode(), 3).is_err());
        assert!(SkinFrame::decode(&frame.encode()[..39], 2).is_err());
    }
}
