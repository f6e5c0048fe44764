//! Signed error maps.

use super::distance::{Nearest, Surface};
use super::statistics::vertex_areas;
use super::{EvaluateError, FaceRegion, Statistics, statistics};
use crate::control::Control;
use crate::geometry::{Motion, TriMesh};

/// Histogram: bins of this width between plus and minus the limit, mm.
const BIN_MM: f64 = 0.25;
const LIMIT_MM: f64 = 3.0;

/// Signed distance map between two surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMap {
    /// Per prediction vertex: signed distance to the reference, mm; NaN where the closest point lies on the reference's
    /// open border.
    pub signed_mm: Vec<f32>,
    /// Statistics over the mask.
    pub whole: Statistics,
    /// The other direction: reference vertices to the prediction (its masked triangles), with the same sign: negative
    /// where the prediction lies behind the reference.
    pub backward: Statistics,
    /// Statistics per region; regions without a counted vertex are left out.
    pub regions: Vec<(&'static str, Statistics)>,
    /// Histogram over the mask: lower edges (mm) and shares of area, bins of 0.25 mm from -3 to 3. The first bin, with
    /// edge -3.25, holds everything below -3, the last one, with edge 3, everything above.
    pub histogram: Vec<(f64, f64)>,
    /// Vertices of the mask that are not counted because their closest point lies on the reference's open border.
    pub excluded: usize,
    /// Motion applied to the prediction before comparing: the identity, unless the caller has registered it and says so here.
    pub registration: Motion,
}

/// Signed error of `prediction` against `reference`. `mask` chooses prediction vertices.
///
/// The distance is that to the closest point, so that an error along the surface does not show. Its sign is that of the
/// angle-weighted pseudonormal of the closest feature: the reference's triangles must be counter-clockwise seen from
/// outside. The reference may be an open patch.
///
/// # Errors
/// [`EvaluateError::Input`] when the mask has another length than the prediction's vertices, or nothing is left to count;
/// cancellation.
pub fn error_map(
    prediction: &TriMesh,
    reference: &TriMesh,
    mask: Option<&[bool]>,
    regions: &[FaceRegion],
    control: &Control,
) -> Result<ErrorMap, EvaluateError> {
    let input = |detail: String| EvaluateError::Input { detail };
    let n = prediction.positions().len();
    if let Some(mask) = mask
        && mask.len() != n
    {
        return Err(input(format!("the mask has {} entries, the prediction {n} vertices", mask.len())));
    }
    let chosen = |v: usize| mask.is_none_or(|m| m[v]);
    control.check()?;
    let surface = Surface::new(reference)?;
    control.report(0.1);
    let value = |hit: &Nearest, sign: f64| if hit.on_border { f32::NAN } else { (sign * hit.signed) as f32 };
    let forward = surface.all_nearest(prediction.positions(), control)?;
    let signed_mm: Vec<f32> = forward.iter().map(|hit| value(hit, 1.0)).collect();
    control.report(0.5);

    // Seen from the reference's vertex the prediction is on the other side: the sign turns.
    let other = Surface::new(prediction)?;
    let back: Vec<f32> = other
        .all_nearest(reference.positions(), control)?
        .iter()
        .map(|hit| {
            let corners = prediction.triangles()[hit.triangle];
            if corners.into_iter().all(|v| chosen(v as usize)) { value(hit, -1.0) } else { f32::NAN }
        })
        .collect();
    control.report(0.9);

    let none = || input("no vertex of the prediction has a closest point inside the reference's border".into());
    let whole = statistics(prediction, &signed_mm, mask).ok_or_else(none)?;
    let none =
        || input("no vertex of the reference has a closest point inside the prediction's border and mask".into());
    let backward = statistics(reference, &back, None).ok_or_else(none)?;
    let regions = regions
        .iter()
        .filter_map(|region| {
            let inside: Vec<bool> = prediction
                .positions()
                .iter()
                .enumerate()
                .map(|(v, p)| chosen(v) && region.bounds.contains(p))
                .collect();
            Some((region.name, statistics(prediction, &signed_mm, Some(&inside))?))
        })
        .collect();
    Ok(ErrorMap {
        excluded: (0..n).filter(|v| chosen(*v) && signed_mm[*v].is_nan()).count(),
        histogram: histogram(prediction, &signed_mm, mask),
        signed_mm,
        whole,
        backward,
        regions,
        registration: Motion::identity(),
    })
}

fn histogram(mesh: &TriMesh, values: &[f32], mask: Option<&[bool]>) -> Vec<(f64, f64)> {
    let inner = (2.0 * LIMIT_MM / BIN_MM) as usize;
    let mut bins: Vec<(f64, f64)> = (0..inner + 2).map(|i| (-LIMIT_MM + BIN_MM * (i as f64 - 1.0), 0.0)).collect();
    let mut total = 0.0;
    for (v, area) in vertex_areas(mesh).into_iter().enumerate() {
        if values[v].is_nan() || mask.is_some_and(|m| !m[v]) {
            continue;
        }
        let bin = ((f64::from(values[v]) + LIMIT_MM) / BIN_MM).floor() + 1.0;
        bins[bin.clamp(0.0, (inner + 1) as f64) as usize].1 += area;
        total += area;
    }
    if total > 0.0 {
        bins.iter_mut().for_each(|b| b.1 /= total);
    }
    bins
}
