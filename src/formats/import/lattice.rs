//! Lattice of a volume's voxels, and the checks that all volume formats share.

use super::error::{at_most, check_size, malformed};
use super::{ImportError, Limits};
use nalgebra::Matrix3;
use prosopon_geometry::{Aabb, Point, Vector, Warning};

/// Most voxels along one axis.
const MAX_EXTENT: usize = 0x7fff;

/// Position of the first voxel and steps to its neighbours, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VoxelLattice {
    /// Centre of the first voxel.
    pub(super) origin: Point,
    /// Steps to the next voxel along i, j and k.
    pub(super) axes: [Vector; 3],
}

/// The number of voxels; an error when `dims` or the limits do not allow it.
pub(super) fn n_voxels(format: &'static str, dims: [usize; 3], limits: &Limits) -> Result<usize, ImportError> {
    if !dims.iter().all(|d| (2..=MAX_EXTENT).contains(d)) {
        return Err(malformed(format, format!("{dims:?} voxels, expected three dimensions of 2 to {MAX_EXTENT}")));
    }
    let n = dims.iter().fold(1u64, |n, d| n.saturating_mul(*d as u64));
    at_most("voxels", n, limits.max_voxels)?;
    Ok(n as usize)
}

impl VoxelLattice {
    /// Refuses axes that are not finite or lie in one plane, and boxes of implausible size; warns of an unusual size.
    ///
    /// Sheared axes (gantry tilt) are allowed.
    pub(super) fn check(
        &self,
        format: &'static str,
        dims: [usize; 3],
        warnings: &mut Vec<Warning>,
    ) -> Result<(), ImportError> {
        let finite = self.origin.iter().chain(self.axes.iter().flatten()).all(|c| c.is_finite());
        let volume = Matrix3::from_columns(&self.axes).determinant().abs();
        let in_space = volume > 1e-3 * self.axes.iter().map(|a| a.norm()).product::<f64>();
        if !finite || !in_space {
            return Err(malformed(format, "the steps between voxels are zero, not finite, or all in one plane"));
        }
        self.check_extent(dims, warnings)
    }

    /// Checks the size of the box around all voxels.
    pub(super) fn check_extent(&self, dims: [usize; 3], warnings: &mut Vec<Warning>) -> Result<(), ImportError> {
        check_size(Aabb::of(&self.corners(dims)).map_or(0.0, |b| b.diagonal()), warnings)
    }

    /// Centres of the eight voxels at the corners; bit `a` of the index is set at the far end of axis `a`.
    pub(super) fn corners(&self, dims: [usize; 3]) -> [Point; 8] {
        let [i, j, k] = dims.map(|d| d.saturating_sub(1) as f64);
        [0u8, 1, 2, 3, 4, 5, 6, 7].map(|c| {
            let end = |a: u8, far: f64| if c >> a & 1 == 1 { far } else { 0.0 };
            self.position([end(0, i), end(1, j), end(2, k)])
        })
    }

    /// Centre of the voxel `index`.
    #[expect(clippy::arithmetic_side_effects, reason = "floating point")]
    pub(super) fn position(&self, index: [f64; 3]) -> Point {
        self.origin + self.axes[0] * index[0] + self.axes[1] * index[1] + self.axes[2] * index[2]
    }
}

/// Steps or sizes for messages: `0.5 x 0.5 x 1 mm`.
pub(super) fn lengths(mm: [f64; 3]) -> String {
    let [x, y, z] = mm.map(|length| (length * 1e4).round() / 1e4);
    format!("{x} x {y} x {z} mm")
}

/// Exactly `N` finite numbers separated by white space.
pub(super) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let found: Option<Vec<f64>> = text
        .split_whitespace()
        .take(N.saturating_add(1))
        .map(|w| w.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect();
    found?.try_into().ok()
}

/// Exactly `N` counts separated by white space.
pub(super) fn counts<const N: usize>(text: &str) -> Option<[usize; N]> {
    let found: Option<Vec<usize>> = text.split_whitespace().take(N.saturating_add(1)).map(|w| w.parse().ok()).collect();
    found?.try_into().ok()
}
