//! Signed error maps between a predicted and a reference surface.

use super::distance::{Nearest, Surface};
use super::plausible::plausible;
use super::smoothing::{Neighbourhoods, roughness};
use super::statistics::vertex_areas;
use super::tuning::{BIN_MM, HISTOGRAM_LIMIT_MM, OPPOSITE, SMOOTHED_MM, UNREGISTERED_MM};
use super::{EvaluateError, FaceRegion, Statistics, statistics};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Vector, Warning};

/// Signed distance map between two surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMap {
    /// Signed distance of each prediction vertex to the reference, mm.
    /// It is NaN where the closest point lies on the reference's open border.
    pub signed_mm: Vec<f32>,
    /// Statistics of [`ErrorMap::signed_mm`] over the mask.
    pub whole: Statistics,
    /// Statistics from reference vertices to the masked triangles of the prediction.
    /// The sign has the same meaning as in [`ErrorMap::signed_mm`]: negative where the prediction lies behind the reference.
    pub backward: Statistics,
    /// Statistics per region; regions without a counted vertex are omitted.
    pub regions: Vec<(&'static str, Statistics)>,
    /// Statistics of the reverse direction per region.
    pub backward_regions: Vec<(&'static str, Statistics)>,
    /// [`ErrorMap::whole`] after the signed values are averaged over neighbourhoods of 5 mm.
    /// The averaging removes scan noise, which increases every unsmoothed distance, and detail finer than the neighbourhood.
    pub smoothed: Statistics,
    /// Root mean square of the part that the averaging removes (noise and fine detail), mm.
    pub roughness_mm: f64,
    /// Distances between corresponding vertices, present when both surfaces have the same triangles.
    /// They include the tangential error, which closest-point distances do not show.
    pub correspondence: Option<Correspondence>,
    /// Histogram over the mask: lower bin edges (mm) and shares of area.
    /// The bins are 0.25 mm wide from -3 to 3. The first bin, with edge -3.25, holds everything below -3; the last, with edge
    /// 3, holds everything above 3.
    pub histogram: Vec<(f64, f64)>,
    /// Number of masked vertices that are not counted.
    /// Their closest point lies on the reference's open border.
    pub excluded: usize,
    /// Doubts about the pair of surfaces.
    pub warnings: Vec<Warning>,
}

/// Distances between corresponding vertices of two surfaces with the same triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Correspondence {
    /// Distance per vertex, mm.
    pub distance_mm: Vec<f32>,
    /// Statistics over the mask; all values are at least 0.
    pub whole: Statistics,
}

/// Computes the signed error of `prediction` against `reference` at the vertices in `mask`.
///
/// `mask` has one entry per prediction vertex; `None` selects all.
///
/// The magnitude is the distance to the closest point of the reference, so tangential errors do not show. The sign is that of
/// the angle-weighted pseudonormal of the closest feature: the reference's triangles must be counter-clockwise seen from
/// outside. The reference may be an open patch.
///
/// # Errors
/// [`EvaluateError::Input`] when the length of the mask is not the number of prediction vertices, when no vertex is left to
/// count, when the surfaces are in different units, or when they face opposite ways, so that no sign would be correct.
/// [`EvaluateError::Cancelled`] on cancellation.
///
/// # Examples
/// A horizontal patch 1 mm behind a parallel reference whose outward normal is +z has an error of -1 mm.
/// ```
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Point, TriMesh};
/// use prosopon_planning::evaluate::error_map;
///
/// let square = |half: f64, z: f64| {
///     let points = [[-half, -half], [half, -half], [half, half], [-half, half], [0.0, 0.0]];
///     let triangles = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
///     TriMesh::new(points.map(|[x, y]| Point::new(x, y, z)).to_vec(), triangles)
/// };
/// let map = error_map(&square(10.0, -1.0)?, &square(20.0, 0.0)?, None, &[], &Control::new())?;
/// assert!((map.whole.mean + 1.0).abs() < 1e-6);
/// assert_eq!(map.excluded, 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn error_map(
    prediction: &TriMesh,
    reference: &TriMesh,
    mask: Option<&[bool]>,
    regions: &[FaceRegion],
    control: &Control,
) -> Result<ErrorMap, EvaluateError> {
    let input = |detail: String| EvaluateError::Input { detail };
    let n = prediction.positions().len();
    check_mask(mask, n)?;
    let chosen = |v: usize| mask.is_none_or(|m| m[v]);
    control.check()?;
    let mut warnings = plausible(prediction, reference)?;
    let surface = Surface::new(reference)?;
    control.report(0.1);
    let value = |hit: &Nearest, sign: f64| if hit.on_border { f32::NAN } else { (sign * hit.signed) as f32 };
    let forward = surface.all_nearest(prediction.positions(), control)?;
    let areas = vertex_areas(prediction);
    if agreement(prediction, &forward, &areas) < OPPOSITE {
        return Err(input(
            "the surfaces face opposite ways: one is inside out or mirrored; reverse its triangles".into(),
        ));
    }
    let signed_mm: Vec<f32> = forward.iter().map(|hit| value(hit, 1.0)).collect();
    control.report(0.5);

    // Behind the prediction as seen from a reference vertex means in front of the reference, so the sign is reversed.
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

    let none = || input("all prediction vertices project onto the reference's border: enlarge the reference".into());
    let whole = statistics(prediction, &signed_mm, mask).ok_or_else(none)?;
    let none =
        || input("no reference vertex projects inside the prediction's border and mask: enlarge the mask".into());
    let backward = statistics(reference, &back, None).ok_or_else(none)?;
    let mut counted = signed_mm.clone();
    (0..n).filter(|v| !chosen(*v)).for_each(|v| counted[v] = f32::NAN);
    let averaged = Neighbourhoods::new(prediction, SMOOTHED_MM).averaged(&counted);
    if whole.mean_abs > UNREGISTERED_MM {
        let message = format!("the mean distance is {:.0} mm: the surfaces are not registered", whole.mean_abs);
        let action = "Register them, and check that both show one head in one frame (LPS, mm).";
        warnings.push(Warning::unreliable("not-registered", message).act(action));
    }
    Ok(ErrorMap {
        excluded: (0..n).filter(|v| chosen(*v) && signed_mm[*v].is_nan()).count(),
        histogram: histogram(&areas, &signed_mm, mask),
        regions: by_region(regions, prediction, &signed_mm, chosen),
        backward_regions: by_region(regions, reference, &back, |_| true),
        smoothed: statistics(prediction, &averaged, mask).unwrap_or_else(|| whole.clone()),
        roughness_mm: roughness(prediction, &counted, &averaged),
        correspondence: correspondence(prediction, reference, mask),
        signed_mm,
        whole,
        backward,
        warnings,
    })
}

/// Refuses a mask that does not fit a surface of `n` vertices or selects none of them.
fn check_mask(mask: Option<&[bool]>, n: usize) -> Result<(), EvaluateError> {
    let detail = match mask {
        Some(mask) if mask.len() != n => {
            format!("the mask has {} entries, but the prediction has {n} vertices", mask.len())
        }
        Some(mask) if !mask.contains(&true) => {
            "the mask selects no vertex of the prediction: enlarge the mask".to_owned()
        }
        Some(_) | None => return Ok(()),
    };
    Err(EvaluateError::Input { detail })
}

/// Statistics of `values` over the vertices of each region that are `counted`; regions without such vertices are omitted.
fn by_region(
    regions: &[FaceRegion],
    mesh: &TriMesh,
    values: &[f32],
    counted: impl Fn(usize) -> bool,
) -> Vec<(&'static str, Statistics)> {
    let of = |region: &FaceRegion| {
        let inside = |(v, p)| counted(v) && region.contains(p);
        let inside: Vec<bool> = mesh.positions().iter().enumerate().map(inside).collect();
        Some((region.name, statistics(mesh, values, Some(&inside))?))
    };
    regions.iter().filter_map(of).collect()
}

/// Area-weighted mean cosine between the prediction's normals and those of the reference at the closest points.
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
    let inner = (2.0 * HISTOGRAM_LIMIT_MM / BIN_MM) as usize;
    let mut bins: Vec<(f64, f64)> =
        (0..inner + 2).map(|i| (-HISTOGRAM_LIMIT_MM + BIN_MM * (i as f64 - 1.0), 0.0)).collect();
    let mut total = 0.0;
    for (v, area) in areas.iter().enumerate() {
        if values[v].is_nan() || mask.is_some_and(|m| !m[v]) {
            continue;
        }
        let bin = ((f64::from(values[v]) + HISTOGRAM_LIMIT_MM) / BIN_MM).floor() + 1.0;
        bins[bin.clamp(0.0, (inner + 1) as f64) as usize].1 += area;
        total += area;
    }
    if total > 0.0 {
        bins.iter_mut().for_each(|b| b.1 /= total);
    }
    bins
}
