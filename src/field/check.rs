use super::distance_field::DistanceField;
use super::exact::ExactDistance;
use crate::control::{Cancelled, Control};
use crate::geometry::{Implicit, Point, TriMesh};
use rayon::prelude::*;

/// Surface points from which the sample is drawn; each gives up to three points of the band.
const SITES: usize = 2000;

/// Differences between a field and the exact distance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub(super) max_error_mm: f64,
    pub(super) rms_error_mm: f64,
    pub(super) points: usize,
}

/// Compares `field` with `exact` at a fixed sample: for sites spread over the surface's area a point off the surface within
/// the band, a point on an edge of the same triangle, and the point below the surface where the closest point jumps (on the
/// medial axis) when that lies within the band.
pub(super) fn measure(
    field: &DistanceField,
    exact: &ExactDistance,
    surface: &TriMesh,
    band: f64,
    control: &Control,
) -> Result<Measured, Cancelled> {
    let mut total = 0.0;
    let sums: Vec<f64> = (0..surface.triangles().len())
        .map(|t| {
            total += surface.scaled_normal(t).norm();
            total
        })
        .collect();
    let errors = (0..SITES)
        .into_par_iter()
        .map(|n| {
            control.check()?;
            let target = total * (n as f64 + 0.5) / SITES as f64;
            let t = sums.partition_point(|&s| s < target).min(sums.len() - 1);
            let points = site(exact, surface, t, n, band);
            Ok(points.into_iter().flatten().map(|p| (field.value(&p) - exact.signed(&p)).abs()).collect::<Vec<_>>())
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let (mut max, mut sum, mut points) = (0.0f64, 0.0, 0);
    for error in errors.into_iter().flatten() {
        max = max.max(error);
        sum += error * error;
        points += 1;
    }
    Ok(Measured { max_error_mm: max, rms_error_mm: (sum / f64::from(points.max(1))).sqrt(), points: points as usize })
}

fn site(exact: &ExactDistance, surface: &TriMesh, t: usize, n: usize, band: f64) -> [Option<Point>; 3] {
    let [a, b, c] = surface.corners(t);
    // Low-discrepancy sequence of Roberts (R3): the same points on every run.
    let [mut u, mut v, w] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3]
        .map(|alpha: f64| (0.5 + alpha * n as f64).fract());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let on_face = a + (b - a) * u + (c - a) * v;
    let on_edge = Some(a + (b - a) * w);
    let Some(normal) = surface.scaled_normal(t).try_normalize(0.0) else { return [Some(on_face), on_edge, None] };
    let off = on_face + normal * (band * (2.0 * w - 1.0));
    // The ball that touches the surface at the site from below grows until it touches elsewhere.
    let slot = exact.nearest(&on_face, 0).slot;
    let touches_only_here =
        |depth: f64| exact.nearest(&(on_face - normal * depth), slot).distance_sq.sqrt() >= depth * (1.0 - 1e-6);
    let medial = (!touches_only_here(band)).then(|| {
        let (mut low, mut high) = (0.0, band);
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            if touches_only_here(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        on_face - normal * low
    });
    [Some(off), on_edge, medial]
}
