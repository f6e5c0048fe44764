//! Volume that two solids share.

use rayon::prelude::*;

use super::moved_solid::Solid;
use super::tuning::{CELL_EDGE_MM, CELL_EDGE_SHARE, CELL_SAMPLES};
use prosopon_geometry::{Aabb, Motion, Point, Vector};

/// Volume that solid `a` shares with solid `b`, mm³; `b_from_a` maps points of `a` into the frame of `b`.
///
/// Cells within `bounds` (in the frame of `a`) are halved until they lie outside one solid, inside both, or have the least
/// edge; in the smallest cells both surfaces are taken to be plane. Faces in contact share no volume.
pub(super) fn volume(a: &Solid, b: &Solid, b_from_a: &Motion, bounds: &Aabb) -> f64 {
    let extent = bounds.max - bounds.min;
    let least = (CELL_EDGE_SHARE * extent.max()).clamp(CELL_EDGE_MM[0], CELL_EDGE_MM[1]);
    let levels = (extent.max() / least).max(1.0).log2().ceil() as i32;
    // Threads share cells of up to 16 times the least edge; summed in order, so that the result is the same on any number of
    // threads.
    let edge = least * 2f64.powi(levels.min(4));
    let count = [0, 1, 2].map(|axis| (extent[axis] / edge).ceil().max(1.0) as usize);
    let cells: Vec<f64> = (0..count.iter().product::<usize>())
        .into_par_iter()
        .map(|i| {
            let at = [i % count[0], i / count[0] % count[1], i / (count[0] * count[1])];
            let middle = bounds.min + Vector::from(at.map(|k| (k as f64 + 0.5) * edge));
            cell(a, b, b_from_a, &middle, edge, least)
        })
        .collect();
    cells.iter().sum()
}

fn cell(a: &Solid, b: &Solid, b_from_a: &Motion, middle: &Point, edge: f64, least: f64) -> f64 {
    let reach = 0.5 * edge * 3f64.sqrt();
    let (da, na) = a.signed_towards(middle);
    if da > reach {
        return 0.0;
    }
    let (db, nb) = b.signed_towards(&(b_from_a * middle));
    if db > reach {
        return 0.0;
    }
    if da < -reach && db < -reach {
        return edge.powi(3);
    }
    if edge > 1.5 * least {
        let quarter = 0.25 * edge;
        let corner = |i: usize| {
            let side = |bit: usize| if i >> bit & 1 == 1 { quarter } else { -quarter };
            middle + Vector::new(side(0), side(1), side(2))
        };
        return (0..8).map(|i| cell(a, b, b_from_a, &corner(i), 0.5 * edge, least)).sum();
    }
    let nb = b_from_a.rotation.inverse() * nb;
    // The centre lies exactly on a surface, where the direction is unknown: too rare to matter.
    if na == Vector::zeros() || nb == Vector::zeros() {
        return 0.0;
    }
    let offset = |k: usize| ((k as f64 + 0.5) / CELL_SAMPLES as f64 - 0.5) * edge;
    let mut inside = 0;
    for k in 0..CELL_SAMPLES {
        for j in 0..CELL_SAMPLES {
            for i in 0..CELL_SAMPLES {
                let o = Vector::new(offset(i), offset(j), offset(k));
                inside += usize::from(da + na.dot(&o) < 0.0 && db + nb.dot(&o) < 0.0);
            }
        }
    }
    edge.powi(3) * inside as f64 / (CELL_SAMPLES.pow(3) as f64)
}
