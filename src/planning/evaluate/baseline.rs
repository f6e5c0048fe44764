//! What simple predictions would score on the points of an error map.

use super::distance::Surface;
use super::{ErrorMap, EvaluateError, FaceRegion, Statistics, statistics};
use prosopon_geometry::TriMesh;
use prosopon_geometry::control::Control;

/// Error of a simple prediction on the points of an error map.
#[derive(Debug, Clone, PartialEq)]
pub struct BaselineError {
    /// Over the points that count in [`ErrorMap::whole`].
    pub whole: Statistics,
    /// Over the points of each of [`ErrorMap::regions`].
    pub regions: Vec<(&'static str, Statistics)>,
}

/// Error of the surface `baseline` against `reference`, at the vertices that count in the error map `map` of `prediction`.
///
/// `baseline` has the triangles of `prediction` with its vertices elsewhere. A vertex lies in the region in which it lies in the
/// prediction and has its weight there, so that map and baseline differ in the positions only. A vertex whose closest point lies
/// on the reference's open border is not counted; [`Statistics::count`] then is smaller than the map's.
///
/// Returns `None` when no vertex is counted.
///
/// # Errors
/// [`EvaluateError::Input`] when the numbers of vertices differ or a surface is not usable; [`EvaluateError::Cancelled`].
pub fn baseline_error(
    (prediction, map): (&TriMesh, &ErrorMap),
    baseline: &TriMesh,
    reference: &TriMesh,
    mask: Option<&[bool]>,
    regions: &[FaceRegion],
    control: &Control,
) -> Result<Option<BaselineError>, EvaluateError> {
    let n = prediction.positions().len();
    if baseline.positions().len() != n || map.signed_mm.len() != n || mask.is_some_and(|m| m.len() != n) {
        let detail = format!(
            "the baseline has {} vertices and the error map {}, but the prediction has {n}",
            baseline.positions().len(),
            map.signed_mm.len()
        );
        return Err(EvaluateError::Input { detail });
    }
    let counts = |v: usize| map.signed_mm[v].is_finite() && mask.is_none_or(|m| m[v]);
    let counted: Vec<usize> = (0..n).filter(|v| counts(*v)).collect();
    let points: Vec<_> = counted.iter().map(|v| baseline.positions()[*v]).collect();
    let mut signed_mm = vec![f32::NAN; n];
    for (v, hit) in counted.iter().zip(Surface::new(reference)?.all_nearest(&points, control)?) {
        if !hit.on_border {
            signed_mm[*v] = hit.signed as f32;
        }
    }
    let of = |region: &FaceRegion| {
        let inside: Vec<bool> = prediction.positions().iter().map(|p| region.contains(p)).collect();
        Some((region.name, statistics(prediction, &signed_mm, Some(&inside))?))
    };
    let regions = regions.iter().filter_map(of).collect();
    Ok(statistics(prediction, &signed_mm, None).map(|whole| BaselineError { whole, regions }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::error_map;
    use prosopon_geometry::{Aabb, Point, Vector};

    /// A square patch at height `z` with outward normal +z.
    fn patch(half: f64, z: f64) -> TriMesh {
        let n = 21usize;
        let node = |i: usize, j: usize| (i + n * j) as u32;
        let step = 2.0 * half / (n - 1) as f64;
        let places = (0..n * n).map(|k| (k % n, k / n));
        let positions = places.map(|(i, j)| Point::new(step * i as f64 - half, step * j as f64 - half, z)).collect();
        let cells = (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (i, j)));
        let triangles = cells.flat_map(|(i, j)| {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    /// The truth lies 10 mm out; the prediction reaches 9, skin at rest 0, and 0.7 of the bone 7 mm: errors -1, -10 and -3.
    #[test]
    fn a_uniform_motion_leaves_all_of_it_and_three_tenths_of_it() {
        let (rest, reference, control) = (patch(20.0, 0.0), patch(40.0, 10.0), Control::new());
        let at = |z: f64| {
            let up = rest.positions().iter().map(|p| p + Vector::new(0.0, 0.0, z)).collect();
            rest.with_positions(up).unwrap()
        };
        let prediction = at(9.0);
        let left = Aabb { min: Point::new(0.0, -20.0, 5.0), max: Point::new(20.0, 20.0, 12.0) };
        let regions = [FaceRegion::new("cheek_left", left)];
        let mask: Vec<bool> = rest.positions().iter().map(|p| p.y < 5.0).collect();
        let map = error_map(&prediction, &reference, Some(&mask), &regions, &control).unwrap();
        let of = |baseline: &TriMesh| {
            let found = baseline_error((&prediction, &map), baseline, &reference, Some(&mask), &regions, &control);
            found.unwrap().unwrap()
        };
        for (baseline, error) in [(at(0.0), -10.0), (at(7.0), -3.0), (at(9.0), -1.0)] {
            let found = of(&baseline);
            // The region is that of the prediction, although the baseline lies below its box.
            assert_eq!(found.regions.len(), 1);
            for s in [&found.whole, &found.regions[0].1] {
                for value in [s.mean, -s.mean_abs, -s.p95] {
                    assert!((value - error).abs() < 1e-6, "{value} {error}");
                }
            }
            assert_eq!((found.whole.count, found.regions[0].1.count), (map.whole.count, map.regions[0].1.count));
        }
        assert_eq!(of(&prediction).whole, map.whole);
    }

    #[test]
    fn another_number_of_vertices_is_refused() {
        let (rest, reference, control) = (patch(20.0, 0.0), patch(40.0, 1.0), Control::new());
        let map = error_map(&rest, &reference, None, &[], &control).unwrap();
        let other = patch(20.0, 0.0).moved(&prosopon_geometry::Motion::identity());
        assert!(baseline_error((&rest, &map), &other, &reference, None, &[], &control).unwrap().is_some());
        let short = baseline_error((&rest, &map), &reference, &reference, Some(&[true]), &[], &control);
        assert!(matches!(short, Err(EvaluateError::Input { .. })));
    }
}
