//! How near cuts come to what must not be cut: nerves, roots.

use parry3d_f64::math::{Pose, Vector as ParryVector};
use parry3d_f64::query;
use parry3d_f64::shape::{Segment as Stretch, TriMesh as Shape};

use super::{Osteotomy, PlanError};
use prosopon_geometry::{Point, Vector};

/// A point, or a curve through several, that cuts should keep away from.
#[derive(Debug, Clone, PartialEq)]
pub struct Protected {
    /// What it is, such as `inferior_alveolar_nerve_left`.
    pub name: String,
    /// One point, or the corners of a curve, LPS mm.
    pub points: Vec<Point>,
    /// Distance below which there is a warning, mm.
    pub margin_mm: Option<f64>,
}

/// How near a cut comes.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    /// The cut.
    pub cut: usize,
    /// Which of the protected.
    pub protected: usize,
    /// Least distance between it and the sides of the slot, mm; 0 where it is cut.
    pub distance_mm: f64,
    /// The point of the protected curve that is nearest, LPS mm.
    pub place: Point,
}

/// Distance of every protected point or curve from every cut that cuts, by cut.
///
/// A cut counts as far as it was given, also where it runs beside the bone; endless planes count within the bone's bounds.
///
/// # Errors
/// [`PlanError::Value`] for coordinates that are not finite or no points.
pub fn clearances(osteotomy: &Osteotomy, protected: &[Protected]) -> Result<Vec<Clearance>, PlanError> {
    for (i, p) in protected.iter().enumerate() {
        if p.points.is_empty() || p.points.iter().any(|p| !p.iter().all(|c| c.is_finite())) {
            let (what, detail) = (format!("protected[{i}].points"), "must be one finite point or more".to_owned());
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
        let Some(surface) = cut.surface(&bounds.center(), bounds.diagonal())? else { continue };
        let corners = surface.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
        let Ok(shape) = Shape::new(corners, surface.triangles().to_vec()) else { continue };
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

fn stretches(points: &[Point]) -> impl Iterator<Item = (Point, Point)> {
    let single = (points.len() == 1).then(|| (points[0], points[0]));
    single.into_iter().chain(points.windows(2).map(|w| (w[0], w[1])))
}

/// Distance of a stretch from a cut, and its nearest point.
fn nearest(shape: &Shape, a: &Point, b: &Point) -> Option<(f64, Point)> {
    let corner = |p: &Point| ParryVector::new(p.x, p.y, p.z);
    // A stretch of no length is no shape for the pair query.
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
