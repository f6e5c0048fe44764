use super::crossings::{Crossings, Rows};
use super::exact::{ExactDistance, is_inside};
use super::lattice::Lattice;
use super::tiles::{Source, Tally};
use crate::control::{Cancelled, Control};
use crate::geometry::Vector;
use rayon::prelude::*;

/// Coefficients of the coarse spline of the signed distance, ring included, and the signs found. Beyond `exact_within` (mm)
/// distances may be 1 % too large.
pub(super) fn coefficients(
    lattice: &Lattice,
    exact: &ExactDistance,
    source: Source,
    exact_within: f64,
    control: &Control,
) -> Result<(Vec<f64>, Tally), Cancelled> {
    let rows = Rows { origin: lattice.coarse_origin(), spacing: lattice.coarse_spacing(), dims: lattice.coarse_dims() };
    let [nx, ny, nz] = rows.dims;
    let rim = &source.defects.rim;
    let crossings = Crossings::new(source.mesh, &source.defects.counts, rim, &rows);
    let layers = (0..nz)
        .into_par_iter()
        .map(|k| {
            control.check()?;
            let mut winding = vec![0; nx * ny];
            crossings.for_runs(k, 0..ny, nx, |j, from, to, w| winding[nx * j + from..nx * j + to].fill(w));
            // Those of the row before, and then of this one.
            let mut hints = vec![0; nx + 1];
            let mut inverted = 0;
            let signed: Vec<f64> = winding
                .into_iter()
                .enumerate()
                .map(|(n, closed)| {
                    let p = rows.origin + Vector::new((n % nx) as f64, (n / nx) as f64, k as f64) * rows.spacing;
                    let i = n % nx;
                    let nearest = exact.tree().nearly_nearest(&p, [hints[i], hints[i + 1]], exact_within);
                    hints[i + 1] = nearest.slot;
                    let share = if rim.is_far(&p, 0.0) { 0.0 } else { rim.share(&p) };
                    let winding = f64::from(closed) - share;
                    let inside = is_inside(winding);
                    inverted += usize::from(inside && winding < 0.0);
                    let distance = nearest.distance_sq.sqrt();
                    if inside { -distance } else { distance }
                })
                .collect();
            Ok((signed, inverted))
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let mut tally = Tally::default();
    let mut signed = Vec::with_capacity(nx * ny * nz);
    for (layer, inverted) in layers {
        let inside: Vec<bool> = layer.iter().map(|d| *d < 0.0).collect();
        tally.add(&Tally::count(&inside, inverted));
        signed.extend(layer);
    }
    let strides = [1, nx, nx * ny];
    let mut coefficients = signed.clone();
    for k in 1..nz - 1 {
        for j in 1..ny - 1 {
            for i in 1..nx - 1 {
                let n = i + nx * (j + ny * k);
                let second: f64 = strides.iter().map(|s| signed[n - s] + signed[n + s] - 2.0 * signed[n]).sum();
                coefficients[n] -= second / 8.0;
            }
        }
    }
    control.report(1.0);
    Ok((coefficients, tally))
}
