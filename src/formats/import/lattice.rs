//! Checks shared by the volume formats with a text header.

use super::error::{at_most, malformed};
use super::volume::check_extent;
use super::{ImportError, Limits};
use nalgebra::Matrix3;
use prosopon_geometry::{Point, Vector};

/// Most voxels along one axis.
const MAX_EXTENT: usize = 0x7fff;

/// The number of voxels; an error when `dims` or the limits do not allow it.
pub(super) fn n_voxels(format: &'static str, dims: [usize; 3], limits: &Limits) -> Result<usize, ImportError> {
    if !dims.iter().all(|d| (2..=MAX_EXTENT).contains(d)) {
        return Err(malformed(format, format!("{dims:?} voxels, expected three dimensions of 2 to {MAX_EXTENT}")));
    }
    let n = dims.iter().fold(1u64, |n, d| n.saturating_mul(*d as u64));
    at_most("voxels", n, limits.max_voxels)?;
    Ok(n as usize)
}

/// Refuses axes that are not finite or lie in one plane, and boxes of implausible size.
pub(super) fn check(
    format: &'static str,
    dims: [usize; 3],
    origin: &Point,
    axes: &[Vector; 3],
    warnings: &mut Vec<String>,
) -> Result<(), ImportError> {
    let finite = origin.iter().chain(axes.iter().flatten()).all(|c| c.is_finite());
    let volume = Matrix3::from_columns(axes).determinant().abs();
    let in_space = volume > 1e-3 * axes.iter().map(|a| a.norm()).product::<f64>();
    if !finite || !in_space {
        return Err(malformed(format, "the steps between voxels are zero, not finite, or all in one plane"));
    }
    check_extent(dims, origin, axes, warnings)
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
