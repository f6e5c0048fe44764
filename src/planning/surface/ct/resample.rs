use super::tuning::{
    AIR_HU, AIR_MM, AIRWAY_MM, CUT_SHARE, LID_MM, MAX_AIRWAY_MM2, MAX_HU, MAX_SAMPLES, MAX_SPACING_MM, MIN_HU,
    MIN_SPACING_MM, TISSUE_HU,
};
use crate::surface::SurfaceError;
use nalgebra::Matrix3;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Point, ScalarGrid, Vector, Volume, Warning};
use rayon::prelude::*;
use std::borrow::Cow;

use super::components::Components;

/// A CT resampled on a lattice along L, P and S.
pub(super) struct Resampled {
    pub(super) grid: ScalarGrid,
    /// For each axis, the smaller and the larger side: whether a face there does not cut the head.
    pub(super) is_open: [[bool; 2]; 3],
    pub(super) warnings: Vec<Warning>,
}

/// Checks the properties of the volume that the importer does not guarantee.
pub(super) fn check(volume: &Volume) -> Result<(), SurfaceError> {
    let fault = |detail: String| Err(SurfaceError::Volume { detail });
    if volume.dims.iter().any(|d| *d < 4) {
        return fault(format!("it has {:?} voxels, but at least 4 along each axis are needed", volume.dims));
    }
    let expected = volume.dims.iter().try_fold(1usize, |n, d| n.checked_mul(*d));
    if expected != Some(volume.hu.len()) {
        return fault(format!("it has {:?} voxels but {} values", volume.dims, volume.hu.len()));
    }
    let lengths = volume.axes.map(|a| a.norm());
    if !volume.origin.iter().all(|c| c.is_finite()) || !lengths.iter().all(|l| (0.01..=50.0).contains(l)) {
        return fault(format!("the voxel spacing is {lengths:?} mm, allowed is 0.01 to 50 mm"));
    }
    let det = Matrix3::from_columns(&volume.axes).determinant();
    if det.abs() < 0.1 * lengths.iter().product::<f64>() {
        return fault("the voxel axes lie almost in one plane".into());
    }
    Ok(())
}

/// Samples the volume by Catmull-Rom tricubic interpolation on a lattice of about the in-plane spacing. Positions farther than
/// half a voxel outside the volume are air.
pub(super) fn resample(volume: &Volume, air_below_hu: f64, control: &Control) -> Result<Resampled, Cancelled> {
    let mut warnings = Vec::new();
    let uncut = uncut_faces(volume, air_below_hu);
    let (hu, n_lids) = with_lids(volume, air_below_hu, uncut.len());
    if n_lids > 0 {
        let message = format!("{n_lids} airways that leave the volume were closed at its faces");
        warnings.push(Warning::info("airways-closed", message));
    }
    let [nx, ny, nz] = volume.dims.map(|d| (d - 1) as f64);
    let corner = |i: f64, j: f64, k: f64| volume.origin + volume.axes[0] * i + volume.axes[1] * j + volume.axes[2] * k;
    let corners: Vec<Point> =
        (0..8).map(|c: u8| corner(f64::from(c & 1) * nx, f64::from(c >> 1 & 1) * ny, f64::from(c >> 2) * nz)).collect();
    let mut bounds = Aabb::of(&corners).unwrap_or(Aabb { min: volume.origin, max: volume.origin });
    let mut is_open = [[false; 2]; 3];
    for outward in uncut {
        let side = outward.iamax();
        is_open[side][usize::from(outward[side] > 0.0)] = true;
        if outward[side] > 0.0 {
            bounds.max[side] += AIR_MM;
        } else {
            bounds.min[side] -= AIR_MM;
        }
    }
    let mut spacing = (0.5 * (volume.axes[0].norm() + volume.axes[1].norm())).clamp(MIN_SPACING_MM, MAX_SPACING_MM);
    let samples = |h: f64| (bounds.max - bounds.min).iter().map(|e| (e / h).ceil() + 1.0).product::<f64>();
    if samples(spacing) > MAX_SAMPLES {
        let wanted = spacing;
        spacing *= (samples(spacing) / MAX_SAMPLES).cbrt() * 1.01;
        let message = format!("the volume is large: its lattice has {spacing:.2} mm instead of {wanted:.2} mm");
        warnings.push(Warning::info("coarser-lattice", message));
    }
    let mut grid = ScalarGrid::covering(&bounds, spacing, AIR_HU);
    let dims = grid.dims;
    // The volume need not be aligned with the lattice. The axes are invertible because `check` has tested them.
    let index_from_mm = Matrix3::from_columns(&volume.axes).try_inverse().unwrap_or_else(Matrix3::identity);
    let source = Source { dims: volume.dims, hu: &hu };
    let origin = index_from_mm * (grid.origin - volume.origin);
    let step = index_from_mm * spacing;
    let layers_at_once = 16;
    for first in (0..dims[2]).step_by(layers_at_once) {
        control.check()?;
        control.report(first as f64 / dims[2] as f64);
        let from = first * dims[0] * dims[1];
        let to = (first + layers_at_once).min(dims[2]) * dims[0] * dims[1];
        grid.values[from..to].par_chunks_mut(dims[0]).enumerate().for_each(|(row, values)| {
            let (j, k) = (row % dims[1], first + row / dims[1]);
            for (i, value) in values.iter_mut().enumerate() {
                if let Some(hu) = source.sample(&(origin + step * Vector::new(i as f64, j as f64, k as f64))) {
                    *value = hu;
                }
            }
        });
    }
    Ok(Resampled { grid, is_open, warnings })
}

/// Outward directions of the volume's faces that do not cut the head.
fn uncut_faces(volume: &Volume, air_below_hu: f64) -> Vec<Vector> {
    let [nx, ny, nz] = volume.dims;
    // Number of tissue voxels in each slice across each axis.
    let mut counts = [vec![0usize; nx], vec![0; ny], vec![0; nz]];
    for (row, values) in volume.hu.chunks(nx).enumerate() {
        for (i, _) in values.iter().enumerate().filter(|(_, v)| f64::from(**v) > air_below_hu) {
            counts[0][i] += 1;
            counts[1][row % ny] += 1;
            counts[2][row / ny] += 1;
        }
    }
    let mut uncut = Vec::new();
    for (axis, counts) in volume.axes.iter().zip(&counts) {
        let largest = counts.iter().copied().max().unwrap_or(0) as f64;
        for (face, outward) in [(counts.first(), -axis), (counts.last(), *axis)] {
            if face.is_some_and(|n| (*n as f64) < CUT_SHARE * largest) {
                uncut.push(outward);
            }
        }
    }
    uncut
}

struct Source<'a> {
    dims: [usize; 3],
    hu: &'a [i16],
}

impl Source<'_> {
    fn sample(&self, at: &Vector) -> Option<f32> {
        let mut taps = [[0usize; 4]; 3];
        let mut weights = [[0f32; 4]; 3];
        for a in 0..3 {
            let last = (self.dims[a] - 1) as f64;
            if !(-0.5..=last + 0.5).contains(&at[a]) {
                return None;
            }
            let x = at[a].clamp(0.0, last);
            let base = (x as usize).min(self.dims[a] - 2);
            weights[a] = catmull_rom((x - base as f64) as f32);
            taps[a] = std::array::from_fn(|t| (base + t).saturating_sub(1).min(self.dims[a] - 1));
        }
        let mut sum = 0.0;
        for c in 0..4 {
            let mut plane = 0.0;
            for b in 0..4 {
                let row = self.dims[0] * (taps[1][b] + self.dims[1] * taps[2][c]);
                let mut line = 0.0;
                for a in 0..4 {
                    line += weights[0][a] * f32::from(self.hu[row + taps[0][a]].clamp(MIN_HU, MAX_HU));
                }
                plane += weights[1][b] * line;
            }
            sum += weights[2][c] * plane;
        }
        Some(sum)
    }
}

/// Weights of the four samples around an interval at the parameter `t` in [0, 1].
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// Closes airways that a face of the volume cuts, and returns their number.
/// Air on a face that does not reach the face's rim and extends inward by [`AIRWAY_MM`] is replaced by tissue, [`LID_MM`] deep.
/// Otherwise outside air would enter through the cut throat.
///
/// Where more faces than the lowest cut the head, an airway may leave through an edge of the volume, so that its air reaches the rims
/// of both faces.
fn with_lids(volume: &Volume, air_below_hu: f64, n_uncut: usize) -> (Cow<'_, [i16]>, usize) {
    let mut hu = Cow::Borrowed(volume.hu.as_slice());
    let at_edges = if n_uncut < 5 { airways_at_edges(volume, air_below_hu) } else { Vec::new() };
    let mut closed = 0;
    let strides = [1, volume.dims[0], volume.dims[0] * volume.dims[1]];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (nu, nv) = (volume.dims[u], volume.dims[v]);
        for side in [0, volume.dims[axis] - 1] {
            let at = |s: usize| (s % nu) * strides[u] + (s / nu) * strides[v] + side * strides[axis];
            let air: Vec<bool> = (0..nu * nv).map(|s| f64::from(volume.hu[at(s)]) <= air_below_hu).collect();
            let components = Components::of(&air, [nu, nv, 1]);
            let layers = |mm: f64| ((mm / volume.axes[axis].norm()).ceil() as usize).min(volume.dims[axis]);
            let inward = |s: usize, layer: usize| {
                let layer = if side == 0 { layer } else { side - layer };
                (s % nu) * strides[u] + (s / nu) * strides[v] + layer * strides[axis]
            };
            let is_air = |s: usize, layer: usize| f64::from(volume.hu[inward(s, layer)]) <= air_below_hu;
            let goes_on = components.any(|s| (0..layers(AIRWAY_MM)).all(|layer| is_air(s, layer)));
            let at_edge = components.any(|s| at_edges.binary_search(&at(s)).is_ok());
            let is_airway = |c: usize| goes_on[c] && (!components.at_border[c] || at_edge[c]);
            let enclosed = (0..goes_on.len()).filter(|c| is_airway(*c)).count();
            if enclosed == 0 {
                continue;
            }
            closed += enclosed;
            let lid = components.mask(is_airway);
            let depth = layers(LID_MM);
            let hu = hu.to_mut();
            for s in (0..nu * nv).filter(|s| lid[*s]) {
                for layer in 0..depth {
                    let value = &mut hu[inward(s, layer)];
                    *value = TISSUE_HU.max(*value);
                }
            }
        }
    }
    (hu, closed)
}

/// Voxels of air on the faces of the volume, ascending, in spaces that reach an edge of the volume and are too small for the outside.
fn airways_at_edges(volume: &Volume, air_below_hu: f64) -> Vec<usize> {
    let [nx, ny, _] = volume.dims;
    let n_faces = |at: usize| {
        let place = [at % nx, at / nx % ny, at / nx / ny];
        (0..3).filter(|a| place[*a] == 0 || place[*a] + 1 == volume.dims[*a]).count()
    };
    let mask: Vec<bool> =
        volume.hu.iter().enumerate().map(|(at, v)| f64::from(*v) <= air_below_hu && n_faces(at) > 0).collect();
    let components = Components::of(&mask, volume.dims);
    let at_edge = components.any(|at| n_faces(at) > 1);
    // A voxel of the shell shows a side of about this area.
    let mm2 = Matrix3::from_columns(&volume.axes).determinant().abs().powf(2.0 / 3.0);
    let largest = components.largest();
    let is_airway = |c: usize| at_edge[c] && Some(c) != largest && components.sizes[c] as f64 * mm2 < MAX_AIRWAY_MM2;
    let found = components.mask(is_airway);
    (0..found.len()).filter(|at| found[*at]).collect()
}
