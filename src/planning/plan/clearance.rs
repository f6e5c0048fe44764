//! Distances between cuts and protected structures: nerves, roots.

use parry3d_f64::math::{Pose, Vector as ParryVector};
use parry3d_f64::query;
use parry3d_f64::shape::{Segment as Stretch, TriMesh as Shape};

use super::{Osteotomy, PlanError};
use prosopon_geometry::{Motion, Point, Vector};

/// A point or polyline that cuts should keep away from, such as a nerve.
#[derive(Debug, Clone, PartialEq)]
pub struct Protected {
    /// Name, for example `inferior_alveolar_nerve_left`.
    pub name: String,
    /// One point, or the corners of a polyline, LPS mm.
    pub points: Vec<Point>,
    /// Distance below which there is a warning, mm; `None` for no warning.
    pub margin_mm: Option<f64>,
}

impl Protected {
    /// The structure moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        Self { points: self.points.iter().map(|p| motion * p).collect(), ..self.clone() }
    }
}

/// Distance between one cut and one protected structure.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    /// Index of the cut in [`Osteotomy::cuts`].
    pub cut: usize,
    /// Index of the protected structure.
    pub protected: usize,
    /// Least distance from the structure to the sides of the kerf, mm; 0 when the saw cuts it.
    pub distance_mm: f64,
    /// Point of the structure that is nearest to the cut, LPS mm.
    pub place: Point,
}

/// Distances between every cut and every protected structure, by cut and then by structure.
///
/// A cut counts over its whole extent, also where it lies beside the bone; endless planes count within the bone's bounds.
/// [`CutShape::FreePart`](super::CutShape::FreePart) cuts nothing and has no entries.
///
/// # Errors
/// [`PlanError::Value`] for a structure without points or with a coordinate that is not finite; [`PlanError::Cut`] for a cut
/// whose distances cannot be computed.
///
/// ```
/// use prosopon_geometry::{Point, TriMesh, Vector};
/// use prosopon_planning::plan::{BoundedPlane, Cut, Osteotomy, Protected, Segment, clearances};
///
/// # let corners = [[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.0, 40.0]];
/// # let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// # let surface = TriMesh::new(corners.map(Point::from).to_vec(), triangles)?;
/// # let skull = Segment {
/// #     id: 0,
/// #     name: None,
/// #     volume_mm3: surface.volume(),
/// #     area_mm2: surface.area(),
/// #     centroid: surface.bounds().center(),
/// #     surface,
/// #     bounded_by: vec![0],
/// # };
/// // A horizontal cut at z = 12 mm with a kerf of 1 mm through `skull`.
/// let plane = BoundedPlane { point: Point::new(0.0, 0.0, 12.0), normal: Vector::z(), bounds: None };
/// let cuts = vec![Cut { kerf_mm: 1.0, ..Cut::from(plane).named("genioplasty") }];
/// # let warnings = Vec::new();
/// let osteotomy = Osteotomy { cuts, bone_mm3: skull.volume_mm3, segments: vec![skull], dropped_mm3: 0.0, warnings, arch: None };
///
/// let points = vec![Point::new(5.0, 5.0, 15.0)];
/// let nerve = Protected { name: "mental_nerve_left".to_owned(), points, margin_mm: Some(3.0) };
/// let found = clearances(&osteotomy, &[nerve])?;
/// assert!((found[0].distance_mm - 2.5).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn clearances(osteotomy: &Osteotomy, protected: &[Protected]) -> Result<Vec<Clearance>, PlanError> {
    for (i, p) in protected.iter().enumerate() {
        if p.points.is_empty() || p.points.iter().any(|p| !p.iter().all(|c| c.is_finite())) {
            let (what, detail) =
                (format!("protected[{i}].points"), "must be one or more points of finite numbers".to_owned());
            return Err(PlanError::Value { what, detail });
        }
    }
    let Some(bounds) = osteotomy
        .segments
        .iter()
        .map(|s| s.surface.bounds())
        .reduce(|a, b| prosopon_geometry::Aabb { min: a.min.inf(&b.min), max: a.max.sup(&b.max) })
    else {
        return Ok(Vec::new());
    };
    let mut found = Vec::new();
    for (index, cut) in osteotomy.cuts.iter().enumerate() {
        let Some(surface) = cut.surface(index, &bounds.center(), bounds.diagonal())? else { continue };
        let shape =
            shape_of(surface.positions(), surface.triangles()).map_err(|detail| cut.fault(index, "surface", detail))?;
        for (number, p) in protected.iter().enumerate() {
            let nearest = stretches(&p.points).filter_map(|(a, b)| nearest(&shape, &a, &b));
            if let Some((distance, place)) = nearest.min_by(|a, b| a.0.total_cmp(&b.0)) {
                let distance_mm = (distance - 0.5 * cut.kerf_mm).max(0.0);
                found.push(Clearance { cut: index, protected: number, distance_mm, place });
            }
        }
    }
    Ok(found)
}

/// The surface of a cut, prepared for distances; else why that is not possible.
fn shape_of(positions: &[Point], triangles: &[[u32; 3]]) -> Result<Shape, String> {
    let corners = positions.iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
    Shape::new(corners, triangles.to_vec()).map_err(|e| format!("its clearance cannot be computed: {e}"))
}

fn stretches(points: &[Point]) -> impl Iterator<Item = (Point, Point)> {
    let single = (points.len() == 1).then(|| (points[0], points[0]));
    single.into_iter().chain(points.windows(2).map(|w| (w[0], w[1])))
}

/// Distance from the line segment `a` to `b` to a cut, mm, and the segment's point nearest to the cut.
fn nearest(shape: &Shape, a: &Point, b: &Point) -> Option<(f64, Point)> {
    let corner = |p: &Point| ParryVector::new(p.x, p.y, p.z);
    // The pair query needs a line segment of non-zero length.
    let b = if (b - a).norm() < 1e-6 { a + Vector::new(1e-6, 0.0, 0.0) } else { *b };
    let stretch = Stretch::new(corner(a), corner(&b));
    let still = Pose::identity();
    let found = query::closest_points(&still, &stretch, &still, shape, f64::MAX).ok()?;
    match found {
        query::ClosestPoints::Intersecting => Some((0.0, nalgebra::center(a, &b))),
        query::ClosestPoints::WithinMargin(p, q) => Some(((p - q).length(), Point::new(p.x, p.y, p.z))),
        query::ClosestPoints::Disjoint => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{block, endless, run_all};
    use super::super::{BoundedPlane, Cut};
    use super::*;

    fn protected(points: &[[f64; 3]]) -> Protected {
        Protected { name: "nerve".into(), points: points.iter().map(|p| Point::from(*p)).collect(), margin_mm: None }
    }

    #[test]
    fn a_cut_without_distances_is_reported() {
        assert!(
            shape_of(&[Point::origin()], &[])
                .is_err_and(|detail| detail.starts_with("its clearance cannot be computed: "))
        );
    }

    #[test]
    fn distances_of_points_and_curves_are_those_of_geometry() {
        let plane = endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0]);
        let slot = Cut { kerf_mm: 1.0, ..plane.into() };
        let normal = Vector::x();
        let bounded = BoundedPlane { point: Point::new(3.0, 0.0, 6.0), normal, bounds: Some((Vector::y(), 14.0, 7.0)) };
        let done = run_all(&block(), &[slot, bounded.into()]).unwrap();
        let all = [
            protected(&[[1.0, 1.0, 15.2]]),
            protected(&[[-5.0, 0.0, 20.0], [-5.0, 5.0, 14.2], [-5.0, 9.0, 25.0]]),
            protected(&[[-1.0, 0.0, 2.0], [8.0, 0.0, 2.0]]),
        ];
        let found = clearances(&done, &all).unwrap();
        let of = |cut: usize, p: usize| found.iter().find(|c| (c.cut, c.protected) == (cut, p)).unwrap();
        assert_eq!(found.len(), 6);
        assert!((of(0, 0).distance_mm - 2.5).abs() < 1e-6 && (of(0, 1).distance_mm - 1.5).abs() < 1e-6);
        assert!((of(0, 1).place - Point::new(-5.0, 5.0, 14.2)).norm() < 1e-5);
        assert!((of(0, 2).distance_mm - 9.7).abs() < 1e-6);
        // The upper edge of the rectangle is at z = 13; the curve along x runs through it.
        assert!((of(1, 0).distance_mm - 2.0f64.hypot(2.2)).abs() < 1e-6, "{:?}", of(1, 0));
        assert_eq!(of(1, 2).distance_mm, 0.0);
        assert!(
            clearances(&done, &[protected(&[])]).is_err() && clearances(&done, &[protected(&[[f64::NAN; 3]])]).is_err()
        );
    }
}
