//! Locates metal and the streaks it causes in a CT.

use super::depth::Depth;
use super::distance::Nearest;
use super::tuning::{MARKER_DEPTH_MM, METAL_HU, STREAK_MM, STREAK_REACH_MM};
use nalgebra::Matrix3;
use prosopon_geometry::{Point, ScalarGrid, Volume};
use rayon::prelude::*;

/// Marks the samples near metal.
pub(super) struct Metal {
    near: Vec<bool>,
}

impl Metal {
    pub(super) fn is_near(&self, at: usize) -> bool {
        self.near[at]
    }

    /// Samples near metal that are `of_kind` in a run along S shorter than [`STREAK_MM`].
    pub(super) fn streaks(&self, hu: &ScalarGrid, of_kind: impl Fn(f64) -> bool) -> Vec<bool> {
        let layer = hu.dims[0] * hu.dims[1];
        let enough = (STREAK_MM / hu.spacing).ceil() as usize;
        let mut streaks = vec![false; hu.values.len()];
        let mut heights = vec![0usize; layer];
        for k in 0..=hu.dims[2] {
            for column in 0..layer {
                let at = column + layer * k;
                if k < hu.dims[2] && of_kind(f64::from(hu.values[at])) {
                    heights[column] += 1;
                    continue;
                }
                let height = std::mem::take(&mut heights[column]);
                if height < enough {
                    for below in (1..=height).map(|step| at - step * layer) {
                        streaks[below] = self.near[below];
                    }
                }
            }
        }
        streaks
    }

    /// Marks the samples within reach of metal below the skin and in the slices of that metal.
    /// `None` without metal.
    pub(super) fn find(hu: &ScalarGrid, volume: &Volume, depth: &Depth) -> Option<Self> {
        // A lattice four times coarser is enough, because the reach is long and only approximate.
        let coarse = 4;
        let dims = hu.dims.map(|d| d.div_ceil(coarse));
        let mut metal = vec![false; dims.iter().product()];
        let mut in_slice = vec![false; volume.dims[2]];
        let [nx, ny, _] = volume.dims;
        for (index, _) in volume.hu.iter().enumerate().filter(|(_, v)| **v >= METAL_HU) {
            let slice = index / nx / ny;
            let [i, j, k] = [index % nx, index / nx % ny, slice].map(|c| c as f64);
            let p = volume.origin + volume.axes[0] * i + volume.axes[1] * j + volume.axes[2] * k;
            let Some([i, j, k]) = nearest_sample(hu, &p) else { continue };
            if depth.at(hu.index(i, j, k)) >= MARKER_DEPTH_MM {
                metal[i / coarse + dims[0] * (j / coarse + dims[1] * (k / coarse))] = true;
                in_slice[slice] = true;
            }
        }
        if !in_slice.contains(&true) {
            return None;
        }
        let reach = STREAK_REACH_MM / (hu.spacing * coarse as f64);
        let to_metal = Nearest::of(|at| metal[at].then_some(0.0), dims, reach.ceil() as u16 + 1);
        let slice_from_mm = Matrix3::from_columns(&volume.axes).try_inverse()?.row(2).transpose();
        let [nx, ny, _] = hu.dims;
        let near = |at: usize| {
            let [i, j, k] = [at % nx, at / nx % ny, at / nx / ny];
            let slice = slice_from_mm.dot(&(hu.position(i, j, k) - volume.origin)).round();
            // One more slice on either side allows for interpolation and partial volume.
            let (first, last) =
                ((slice - 1.0).max(0.0) as usize, ((slice + 1.0).max(0.0) as usize).min(in_slice.len() - 1));
            let c = i / coarse + dims[0] * (j / coarse + dims[1] * (k / coarse));
            !to_metal.is_farther(c, reach) && in_slice[first.min(last)..=last].contains(&true)
        };
        Some(Self { near: (0..hu.values.len()).into_par_iter().map(near).collect() })
    }
}

/// Indices of the sample nearest to `p`; `None` farther than half a step outside.
pub(super) fn nearest_sample(grid: &ScalarGrid, p: &Point) -> Option<[usize; 3]> {
    let at = (p - grid.origin) / grid.spacing;
    let inside = (0..3).all(|a| at[a] >= -0.5 && at[a] < grid.dims[a] as f64 - 0.5);
    inside.then(|| [0, 1, 2].map(|a| at[a].round().max(0.0) as usize))
}
