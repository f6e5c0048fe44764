//! The plane about which surfaces are most symmetric.

use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::super::EvaluateError;
use super::super::distance::Surface;
use super::tuning::{
    COARSE_ROUNDS, COARSE_SAMPLES, FINE_ROUNDS, KEPT, MIDDLE_ROUNDS, MIDDLE_SAMPLES, SAME_PLANE_DEG, TRIMMED_SHARE,
};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, Vector};

/// A plane about which a surface is nearly symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MirrorPlane {
    /// Unit normal, of either sense.
    pub(super) normal: Vector,
    /// Distance of the plane from the origin along the normal, mm.
    pub(super) offset: f64,
    /// Mean distance of the mirrored surface from itself over its most symmetric part, mm.
    pub(super) off_mm: f64,
}

impl MirrorPlane {
    fn mirrored(&self, p: &Point) -> Point {
        p - self.normal * (2.0 * (self.normal.dot(&p.coords) - self.offset))
    }

    /// The point of the plane that is closest to `p`.
    pub(super) fn foot(&self, p: &Point) -> Point {
        p - self.normal * (self.normal.dot(&p.coords) - self.offset)
    }
}

/// Surfaces with points of each.
type Sides<'a> = [(&'a Surface, &'a [Point])];

/// The best mirror planes, which differ by more than 12°, the best first.
///
/// The starts lie in a grid along the principal axes of the points, so that they move with the head.
///
/// # Errors
/// [`EvaluateError::Cancelled`].
pub(super) fn mirror_planes(sides: &Sides<'_>, control: &Control) -> Result<Vec<MirrorPlane>, EvaluateError> {
    let all: Vec<Point> = sides.iter().flat_map(|(_, points)| points.iter().copied()).collect();
    let Some((centre, axes)) = principal_axes(&all) else { return Ok(Vec::new()) };
    let run = |plane: MirrorPlane, samples: usize, rounds: usize| {
        control.check()?;
        Ok(refined(sides, plane, samples, rounds))
    };
    let start = |direction: Vector| {
        let normal = axes * direction.normalize();
        MirrorPlane { normal, offset: normal.dot(&centre.coords), off_mm: f64::INFINITY }
    };
    let coarse = directions().into_par_iter().map(|d| run(start(d), COARSE_SAMPLES, COARSE_ROUNDS));
    let kept = distinct(coarse.collect::<Result<_, EvaluateError>>()?, KEPT);
    let middle = kept.into_par_iter().map(|plane| run(plane, MIDDLE_SAMPLES, MIDDLE_ROUNDS));
    let best = distinct(middle.collect::<Result<_, EvaluateError>>()?, 2);
    let fine = best.into_par_iter().map(|plane| run(plane, usize::MAX, FINE_ROUNDS));
    Ok(distinct(fine.collect::<Result<_, EvaluateError>>()?, 2))
}

/// The best planes, at most `count`, without those that nearly agree with a better one.
fn distinct(mut planes: Vec<MirrorPlane>, count: usize) -> Vec<MirrorPlane> {
    planes.sort_by(|a, b| a.off_mm.total_cmp(&b.off_mm));
    let mut kept: Vec<MirrorPlane> = Vec::new();
    for plane in planes {
        let angle = |other: &MirrorPlane| plane.normal.dot(&other.normal).abs().clamp(0.0, 1.0).acos().to_degrees();
        if kept.len() < count && kept.iter().all(|other| angle(other) > SAME_PLANE_DEG) {
            kept.push(plane);
        }
    }
    kept
}

/// Half of the directions to the points of a grid of 5 x 5 x 5 on its surface: 49, about 20° apart.
fn directions() -> Vec<Vector> {
    let steps = -2i32..=2;
    let all = steps.clone().flat_map(|i| steps.clone().flat_map(move |j| (-2i32..=2).map(move |k| [i, j, k])));
    let outer = all.filter(|d| d.iter().any(|c| c.abs() == 2));
    outer.filter(|d| *d > [0, 0, 0]).map(|[i, j, k]| Vector::new(i.into(), j.into(), k.into())).collect()
}

/// The middle of points and their principal axes as columns.
pub(super) fn principal_axes(points: &[Point]) -> Option<(Point, Matrix3<f64>)> {
    let n = points.len() as f64;
    let centre = Point::from(points.iter().map(|p| p.coords).sum::<Vector>() / n);
    let spread: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
    (points.len() > 3 && spread.iter().all(|v| v.is_finite()))
        .then(|| (centre, SymmetricEigen::new(spread).eigenvectors))
}

/// Iterated closest points between each surface and its mirror image, by up to `samples` points of each.
fn refined(sides: &Sides<'_>, start: MirrorPlane, samples: usize, rounds: usize) -> MirrorPlane {
    /// Movement of the normal and of the plane, mm at 100 mm from the middle, below which the iteration has converged.
    const CONVERGED: f64 = 1e-7;
    let mut plane = start;
    for _ in 0..rounds {
        let mut pairs: Vec<(f64, Point, Point)> = Vec::new();
        for (surface, points) in sides {
            // Evenly spaced ones, since successive points lie near each other.
            let stride = points.len().div_ceil(samples).max(1);
            let chosen: Vec<Point> = points.iter().step_by(stride).copied().collect();
            let paired = chosen.par_iter().map(|p| {
                let hit = surface.nearest(&plane.mirrored(p));
                let off = if hit.on_border { f64::INFINITY } else { hit.signed.abs() };
                (off, *p, hit.point)
            });
            let mut paired: Vec<_> = paired.collect();
            let keep = (TRIMMED_SHARE * paired.len() as f64) as usize;
            paired.sort_by(|a, b| a.0.total_cmp(&b.0));
            paired.truncate(keep);
            pairs.extend(paired.into_iter().filter(|pair| pair.0.is_finite()));
        }
        let Some(next) = best_mirror(&pairs) else { break };
        let sense = next.normal.dot(&plane.normal).signum();
        let change = 100.0 * (next.normal - plane.normal * sense).norm();
        plane = next;
        if change < CONVERGED {
            break;
        }
    }
    plane
}

/// The plane whose mirror images of the first points lie closest to the second ones, in least squares.
///
/// The mean of (p - p̄)(q - q̄)ᵀ, made symmetric, is stretched least along its normal.
fn best_mirror(pairs: &[(f64, Point, Point)]) -> Option<MirrorPlane> {
    if pairs.len() < 10 {
        return None;
    }
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&(f64, Point, Point)) -> Vector| pairs.iter().map(of).sum::<Vector>() / n;
    let (p, q) = (mean(&|pair| pair.1.coords), mean(&|pair| pair.2.coords));
    let both: Matrix3<f64> = pairs.iter().map(|(_, a, b)| (a.coords - p) * (b.coords - q).transpose()).sum();
    let eigen = SymmetricEigen::new(both + both.transpose());
    let normal: Vector = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    let off_mm = pairs.iter().map(|pair| pair.0).sum::<f64>() / n;
    let plane = MirrorPlane { normal, offset: normal.dot(&(p + q)) / 2.0, off_mm };
    (plane.offset.is_finite() && normal.norm() > 0.5).then_some(plane)
}
