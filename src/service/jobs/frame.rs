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
    /// Whole number for a vertex without a value in [`Self::encode_short`].
    pub const NO_VALUE: i16 = i16::MIN;
    /// Finest step of [`Self::encode_short`], mm: below what a picture shows, and up to 32 mm fit.
    const FINEST_MM: f32 = 1e-3;

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

    /// Encodes the frame with 16 bits a number, for slow connections.
    ///
    /// Layout, little-endian: f32, the step of all numbers in mm; then i16, in steps: displacement x, y, z of all vertices from
    /// `rest`, then the signed error of each vertex if there is one. [`Self::NO_VALUE`] stands for no value.
    #[must_use]
    pub fn encode_short(&self, rest: &TriMesh) -> Vec<u8> {
        let pairs = self.positions_mm.iter().zip(rest.positions());
        let moved: Vec<[f32; 3]> =
            pairs.map(|(p, from)| [0, 1, 2].map(|i: usize| (f64::from(p[i]) - from[i]) as f32)).collect();
        let values = || moved.iter().flatten().chain(self.error_mm.iter().flatten());
        // NaN is no largest value.
        let largest = values().fold(0.0f32, |most, v| most.max(v.abs()));
        let step_mm = (largest / f32::from(i16::MAX)).max(Self::FINEST_MM);
        let whole = |v: &f32| if v.is_nan() { Self::NO_VALUE } else { (v / step_mm).round() as i16 };
        step_mm.to_le_bytes().into_iter().chain(values().map(whole).flat_map(i16::to_le_bytes)).collect()
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
    fn short_frames_hold_displacements_to_a_micrometre() {
        let positions = [[0.0, 0.0, 100.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point::from);
        let rest = TriMesh::new(positions.to_vec(), vec![[0, 1, 2]]).unwrap();
        let mut frame = SkinFrame::at_rest(&rest);
        frame.positions_mm[1] = [7.0004, 0.0, -2.0];
        frame.error_mm = Some(vec![f32::NAN, 0.25, -0.5]);
        let numbers = |bytes: &[u8]| -> Vec<i16> {
            bytes[4..].as_chunks::<2>().0.iter().map(|b| i16::from_le_bytes(*b)).collect()
        };
        let bytes = frame.encode_short(&rest);
        assert_eq!(bytes[..4], 1e-3f32.to_le_bytes());
        assert_eq!(numbers(&bytes), [0, 0, 0, 6000, 0, -2000, 0, 0, 0, SkinFrame::NO_VALUE, 250, -500]);
        // Farther than 32 mm, the steps are larger.
        frame.positions_mm[1] = [66.534, 0.0, 0.0];
        let bytes = frame.encode_short(&rest);
        let step = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        assert!((f32::from(numbers(&bytes)[3]) * step - 65.534).abs() < 1e-3, "{step}");
    }

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
