use super::{Point, Vector};

/// A CT volume in Hounsfield units.
///
/// Voxel `(i, j, k)` is centred at `origin + i axes[0] + j axes[1] + k axes[2]` (LPS mm) and stored at index
/// `i + dims[0] * (j + dims[1] * k)`. The axes may be oblique or sheared.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Number of voxels along i, j and k.
    pub dims: [usize; 3],
    /// Centre of voxel (0, 0, 0), LPS mm.
    pub origin: Point,
    /// Step from one voxel to the next along i, j and k, LPS mm.
    pub axes: [Vector; 3],
    /// Hounsfield units, i fastest.
    pub hu: Vec<i16>,
}
