//! Signed error maps.

use super::distance::{Nearest, Surface};
use super::plausible::plausible;
use super::smoothing::{Neighbourhoods, roughness};
use super::statistics::vertex_areas;
use super::{EvaluateError, FaceRegion, Statistics, statistics};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Vector};

/// Histogram: bins of this width between plus and minus the limit, mm.
const BIN_MM: f64 = 0.25;
const LIMIT_MM: f64 = 3.0;
/// Standard deviation of the neighbourhoods that [`ErrorMap::smoothed`] averages over, mm.
const SMOOTHED_MM: f64 = 5.0;
/// Mean cosine of the surfaces' normals below which they face opposite ways.
const OPPOSITE: f64 = -0.2;
/// A mean distance above this is no error of a prediction, mm.
const FAR_MM: f64 = 20.0;

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
    /// The other direction per region.
    pub backward_regions: Vec<(&'static str, Statistics)>,
    /// [`ErrorMap::whole`] after averaging the signed values over neighbourhoods of 5 mm: noise of a scan, which adds to every
    /// distance, averages out, and so does detail that is finer.
    pub smoothed: Statistics,
    /// Root mean square of what that averaging takes away, mm: noise and detail.
    pub roughness_mm: f64,
    /// Where both surfaces have the same triangles: distances of each vertex from its own counterpart, with the error along the
    /// surface that closest points hide.
    pub correspondence: Option<Correspondence>,
    /// Histogram over the mask: lower edges (mm) and shares of area, bins of 0.25 mm from -3 to 3. The first bin, with
    /// edge -3.25, holds everything below -3, the last one, with edge 3, everything above.
    pub histogram: Vec<(f64, f64)>,
    /// Vertices of the mask that are not counted because their closest point lies on the reference's open border.
    pub excluded: usize,
    /// What is doubtful about the pair.
    pub warnings: Vec<String>,
}

/// Distances of vertices from their counterparts.
#[derive(Debug, Clone, PartialEq)]
pub struct Correspondence {
    /// Per vertex, mm.
    pub distance_mm: Vec<f32>,
    /// Statistics over the mask; nothing is negative.
    pub whole: Statistics,
}

/// Signed error of `prediction` against `reference`. `mask` chooses prediction vertices.
///
/// The distance is that to the closest point, so that an error along the surface does not show. Its sign is that of the
/// angle-weighted pseudonormal of the closest feature: the reference's triangles must be counter-clockwise seen from
/// outside. The reference may be an open patch.
///
/// # Errors
/// [`EvaluateError::Input`] when the mask has another length than the prediction's vertices, nothing is left to count, the
/// surfaces are in different units, or they face opposite ways (one is inside out), so that no sign is right; cancellation.
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
    if !(0..n).any(chosen) {
        return Err(input("the mask leaves no vertex of the prediction".to_owned()));
    }
    control.check()?;
    let mut warnings = plausible(prediction, reference)?;
    let surface = Surface::new(reference)?;
    control.report(0.1);
    let value = |hit: &Nearest, sign: f64| if hit.on_border { f32::NAN } else { (sign * hit.signed) as f32 };
    let forward = surface.all_nearest(prediction.positions(), control)?;
    let areas = vertex_areas(prediction);
    if agreement(prediction, &forward, &areas) < OPPOSITE {
        return Err(input(
            "the surfaces face opposite ways: one of them is inside out (or mirrored), no sign would be right".into(),
        ));
    }
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
    let by_region = |mesh: &TriMesh, values: &[f32], counted: &dyn Fn(usize) -> bool| {
        let of = |region: &FaceRegion| {
            let inside = |(v, p)| counted(v) && region.bounds.contains(p);
            let inside: Vec<bool> = mesh.positions().iter().enumerate().map(inside).collect();
            Some((region.name, statistics(mesh, values, Some(&inside))?))
        };
        regions.iter().filter_map(of).collect()
    };
    let mut counted = signed_mm.clone();
    (0..n).filter(|v| !chosen(*v)).for_each(|v| counted[v] = f32::NAN);
    let averaged = Neighbourhoods::new(prediction, SMOOTHED_MM).averaged(&counted);
    if whole.mean_abs > FAR_MM {
        warnings.push(format!(
            "the mean distance is {:.0} mm: the surfaces need registration, or are not of one head in one frame (LPS, mm)",
            whole.mean_abs
        ));
    }
    Ok(ErrorMap {
        excluded: (0..n).filter(|v| chosen(*v) && signed_mm[*v].is_nan()).count(),
        histogram: histogram(&areas, &signed_mm, mask),
        regions: by_region(prediction, &signed_mm, &chosen),
        backward_regions: by_region(reference, &back, &|_| true),
        smoothed: statistics(prediction, &averaged, mask).unwrap_or_else(|| whole.clone()),
        roughness_mm: roughness(prediction, &counted, &averaged),
        correspondence: correspondence(prediction, reference, mask),
        signed_mm,
        whole,
        backward,
        warnings,
    })
}

/// Mean cosine between the prediction's normals and those at the closest points, weighted by area.
fn agreement(prediction: &TriMesh, hits: &[Nearest], areas: &[f64]) -> f64 {
    let normals: Vec<Vector> = prediction.vertex_normals();
    let (mut sum, mut total) = (0.0, 0.0);
    for ((hit, normal), area) in hits.iter().zip(&normals).zip(areas).filter(|((hit, _), _)| !hit.on_border) {
        sum += area * normal.dot(&hit.normal);
        total += area;
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

fn correspondence(prediction: &TriMesh, reference: &TriMesh, mask: Option<&[bool]>) -> Option<Correspondence> {
    let (a, b) = (prediction.positions(), reference.positions());
    if a.len() != b.len() || prediction.triangles() != reference.triangles() {
        return None;
    }
    let distance_mm: Vec<f32> = a.iter().zip(b).map(|(p, r)| (p - r).norm() as f32).collect();
    let whole = statistics(prediction, &distance_mm, mask)?;
    Some(Correspondence { distance_mm, whole })
}

fn histogram(areas: &[f64], values: &[f32], mask: Option<&[bool]>) -> Vec<(f64, f64)> {
    let inner = (2.0 * LIMIT_MM / BIN_MM) as usize;
    let mut bins: Vec<(f64, f64)> = (0..inner + 2).map(|i| (-LIMIT_MM + BIN_MM * (i as f64 - 1.0), 0.0)).collect();
    let mut total = 0.0;
    for (v, area) in areas.iter().enumerate() {
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
