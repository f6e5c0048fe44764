//! The midsagittal plane of a face.

use super::samples;
use super::tuning::{MIRROR_CELL_MM, MIRROR_REACH_MM};
use prosopon_geometry::TriMesh;

/// x of the plane about which the front of a surface is most symmetric, mm.
///
/// The foremost points make a map over x and z; the mean difference between the map and its mirror image, limited to 10 mm,
/// is smallest at the midline. Values between the cells are interpolated.
pub(super) fn midline(skin: &TriMesh) -> f64 {
    let bounds = skin.bounds();
    let n = [0, 2].map(|a| ((bounds.max[a] - bounds.min[a]) / MIRROR_CELL_MM).ceil() as usize + 1);
    let mut front = vec![f64::INFINITY; n[0] * n[1]];
    for p in samples(skin, MIRROR_CELL_MM) {
        let [i, k] = [0, 2].map(|a| ((p[a] - bounds.min[a]) / MIRROR_CELL_MM) as usize);
        if let Some(cell) = front.get_mut(i + n[0] * k) {
            *cell = cell.min(p.y);
        }
    }
    let middle = bounds.center();
    let at = |x: f64, row: &[f64]| -> Option<f64> {
        let c = (x - bounds.min.x) / MIRROR_CELL_MM - 0.5;
        let (i, w) = (c.floor(), c - c.floor());
        let (a, b) = (row.get(i.max(0.0) as usize)?, row.get(i.max(0.0) as usize + 1)?);
        (i >= 0.0).then_some(a * (1.0 - w) + b * w).filter(|y| y.is_finite())
    };
    let unlike = |x: f64| {
        let (mut sum, mut count) = (0.0, 0usize);
        for row in front.chunks_exact(n[0]) {
            for d in 1..(MIRROR_REACH_MM / MIRROR_CELL_MM) as u32 {
                let d = f64::from(d) * MIRROR_CELL_MM;
                let (Some(l), Some(r)) = (at(x + d, row), at(x - d, row)) else { continue };
                // The face only: the front half.
                if l.max(r) < middle.y {
                    sum += (l - r).abs().min(10.0);
                    count += 1;
                }
            }
        }
        if count == 0 { f64::INFINITY } else { sum / count as f64 }
    };
    let best = |centre: f64, step: f64| {
        let tried = (-30..=30).map(|i| centre + step * f64::from(i));
        tried.map(|x| (unlike(x), x)).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(centre, |b| b.1)
    };
    best(best(middle.x, 1.0), 0.1)
}
