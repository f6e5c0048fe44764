use super::crossings::{Crossings, Rows};
use super::exact::{ExactDistance, is_inside};
use super::lattice::Lattice;
use super::tiles::Tally;
use super::tree::{Nearest, Tree};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, TriMesh, Vector};
use rayon::prelude::*;

/// For every lattice node a triangle that is probably the nearest.
///
/// Nodes next to the triangles' middles start with those triangles; a forward and a backward sweep pass them to neighbours.
///
/// # Source
/// P.-E. Danielsson, Euclidean distance mapping, *Computer Graphics and Image Processing* 1980.
fn propagate_nearest(rows: &Rows, tree: &Tree) -> Vec<Nearest> {
    let [nx, ny, nz] = rows.dims;
    let at = |n: usize| {
        let node = [n % nx, n / nx % ny, n / (nx * ny)].map(|i| i as f64);
        rows.origin + Vector::from(node) * rows.spacing
    };
    let nothing = Nearest { point: Point::origin(), slot: u32::MAX, distance_sq: f64::INFINITY };
    let mut found = vec![nothing; nx * ny * nz];
    for (slot, [a, b, c]) in tree.corners.iter().enumerate() {
        let middle = ((a.coords + b.coords + c.coords) / 3.0 - rows.origin.coords) / rows.spacing;
        let node = [0, 1, 2].map(|a| (middle[a].round().max(0.0) as usize).min(rows.dims[a] - 1));
        let n = node[0] + nx * (node[1] + ny * node[2]);
        let candidate = tree.of_triangle(&at(n), slot as u32);
        if candidate.distance_sq < found[n].distance_sq {
            found[n] = candidate;
        }
    }
    // The half of the 26 neighbours that precede a node.
    let before: [[isize; 3]; 13] = std::array::from_fn(|n| [n % 3, n / 3 % 3, n / 9].map(|s| s as isize - 1));
    for forth in [true, false] {
        for n in 0..found.len() {
            let n = if forth { n } else { found.len() - 1 - n };
            let (p, node) = (at(n), [n % nx, n / nx % ny, n / (nx * ny)]);
            let mut best = found[n];
            for step in &before {
                let step = if forth { *step } else { step.map(|s| -s) };
                let [Some(i), Some(j), Some(k)] = [0, 1, 2].map(|a| node[a].checked_add_signed(step[a])) else {
                    continue;
                };
                if i >= nx || j >= ny || k >= nz {
                    continue;
                }
                let other = found[i + nx * (j + ny * k)];
                let is_new = other.distance_sq < f64::INFINITY && other.slot != best.slot;
                if is_new && (other.point - p).norm_squared() < best.distance_sq {
                    let candidate = tree.of_triangle(&p, other.slot);
                    best = if candidate.distance_sq < best.distance_sq { candidate } else { best };
                }
            }
            found[n] = best;
        }
    }
    // The two sweeps reach every node.
    debug_assert!(found.iter().all(|f| f.distance_sq < f64::INFINITY));
    found
}

/// Coefficients of the coarse spline of the signed distance, ring included, and the tally of signs.
///
/// Beyond `exact_within` (mm) distances may be 1 % too large.
pub(super) fn coefficients(
    lattice: &Lattice,
    exact: &ExactDistance,
    surface: &TriMesh,
    exact_within: f64,
    control: &Control,
) -> Result<(Vec<f64>, Tally), Cancelled> {
    let rows = Rows { origin: lattice.coarse_origin(), spacing: lattice.coarse_spacing(), dims: lattice.coarse_dims() };
    let [nx, ny, nz] = rows.dims;
    let defects = exact.defects();
    let rim = &defects.rim;
    let crossings = Crossings::new(surface, &defects.counts, rim, &rows);
    let found = propagate_nearest(&rows, exact.tree());
    control.check()?;
    let layers = (0..nz)
        .into_par_iter()
        .map(|k| {
            control.check()?;
            let mut winding = vec![0; nx * ny];
            crossings.for_runs(k, 0..ny, nx, |j, from, to, w| winding[nx * j + from..nx * j + to].fill(w));
            let mut inverted = 0;
            let signed: Vec<f64> = winding
                .into_iter()
                .enumerate()
                .map(|(n, closed)| {
                    let p = rows.origin + Vector::new((n % nx) as f64, (n / nx) as f64, k as f64) * rows.spacing;
                    let nearest = exact.tree().nearly_nearest(&p, found[n + nx * ny * k].slot, exact_within);
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
