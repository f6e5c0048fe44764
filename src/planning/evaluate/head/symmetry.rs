//! The plane about which surfaces are most symmetric.

use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::tuning::{
    COARSE_ROUNDS, COARSE_SAMPLES, CORE_MM, FINE_ROUNDS, KEPT, MIDDLE_ROUNDS, MIDDLE_SAMPLES, SAME_PLANE_DEG,
    TRIMMED_SHARE,
};
use crate::evaluate::EvaluateError;
use crate::evaluate::distance::Surface;
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
    control.check()?;
    Ok(distinct(best.into_par_iter().map(|plane| polished(sides, plane)).collect(), 2))
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

/// A point with the closest point to its mirror image, and the surface's normal there.
struct Pair {
    off: f64,
    from: Point,
    to: Point,
    normal: Vector,
}

/// The pairs of the points of each surface.
fn all_pairs(sides: &Sides<'_>, plane: &MirrorPlane) -> Vec<Vec<Pair>> {
    let pair = |surface: &Surface, p: &Point| {
        let hit = surface.nearest(&plane.mirrored(p));
        let off = if hit.on_border { f64::INFINITY } else { hit.signed.abs() };
        Pair { off, from: *p, to: hit.point, normal: hit.normal }
    };
    sides.iter().map(|(surface, points)| points.par_iter().map(|p| pair(surface, p)).collect()).collect()
}

/// The pairs of each surface but for the share that lies farthest from its mirror image.
fn trimmed(sides: Vec<Vec<Pair>>) -> Vec<Pair> {
    let nearest = |mut pairs: Vec<Pair>| {
        let keep = (TRIMMED_SHARE * pairs.len() as f64) as usize;
        pairs.sort_by(|a, b| a.off.total_cmp(&b.off));
        pairs.truncate(keep);
        pairs
    };
    sides.into_iter().flat_map(nearest).filter(|pair| pair.off.is_finite()).collect()
}

fn mean_off(pairs: &[Pair]) -> f64 {
    pairs.iter().map(|pair| pair.off).sum::<f64>() / pairs.len().max(1) as f64
}

/// Iterated closest points between each surface and its mirror image, point to point: from far away.
fn refined(sides: &Sides<'_>, start: MirrorPlane, samples: usize, rounds: usize) -> MirrorPlane {
    // Evenly spaced ones, since successive points lie near each other.
    let few: Vec<(&Surface, Vec<Point>)> = sides
        .iter()
        .map(|(surface, points)| {
            let stride = points.len().div_ceil(samples).max(1);
            (*surface, points.iter().step_by(stride).copied().collect())
        })
        .collect();
    let few: Vec<(&Surface, &[Point])> = few.iter().map(|(surface, points)| (*surface, points.as_slice())).collect();
    let mut plane = start;
    for _ in 0..rounds {
        let pairs = trimmed(all_pairs(&few, &plane));
        let Some(next) = best_mirror(&pairs) else { break };
        plane = MirrorPlane { off_mm: mean_off(&pairs), ..next };
    }
    plane
}

/// Iterated closest points, point to plane: surfaces slide along themselves, and few rounds suffice.
///
/// Points far from their mirror image count little (Geman and McClure 1985); without a limit that cuts them off, near starts end in one
/// plane.
pub(super) fn polished(sides: &Sides<'_>, start: MirrorPlane) -> MirrorPlane {
    let mut plane = start;
    for _ in 0..FINE_ROUNDS {
        let all = all_pairs(sides, &plane).into_iter().flatten();
        let pairs: Vec<Pair> = all.filter(|pair| pair.off.is_finite()).collect();
        let weight = |pair: &Pair| (1.0 + (pair.off / CORE_MM).powi(2)).powi(-2);
        let total: f64 = pairs.iter().map(weight).sum();
        let off_mm = pairs.iter().map(|pair| weight(pair) * pair.off).sum::<f64>() / total.max(1e-9);
        let n = plane.normal;
        let first = n.cross(&Vector::ith(n.iamin(), 1.0)).normalize();
        let turns = [first, n.cross(&first)];
        let Some(centre) = mean_of(&pairs, |pair| pair.from) else { break };
        let height = |p: &Point| n.dot(&p.coords) - plane.offset;
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector::zeros());
        for pair in &pairs {
            // p' = p - 2 (n·p - d) n, by turns of n about the centre and shifts of d.
            let (p, h, m) = (pair.from - centre, height(&pair.from), pair.normal);
            let [a, b] = turns.map(|e| -2.0 * (e.dot(&p) * m.dot(&n) + h * m.dot(&e)));
            let row = Vector::new(a, b, 2.0 * m.dot(&n));
            let w = weight(pair);
            matrix += row * row.transpose() * w;
            right -= row * (w * m.dot(&(plane.mirrored(&pair.from) - pair.to)));
        }
        let Some(step) = matrix.lu().solve(&right).filter(|step| step.iter().all(|v| v.is_finite())) else { break };
        let at_centre = height(&centre) - step.z;
        let normal = (n + turns[0] * step.x + turns[1] * step.y).normalize();
        plane = MirrorPlane { normal, offset: normal.dot(&centre.coords) - at_centre, off_mm };
    }
    plane
}

fn mean_of(pairs: &[Pair], of: impl Fn(&Pair) -> Point) -> Option<Point> {
    let sum = pairs.iter().map(|pair| of(pair).coords).sum::<Vector>();
    (!pairs.is_empty()).then(|| Point::from(sum / pairs.len() as f64))
}

/// The plane whose mirror images of the first points lie closest to the second ones, in least squares.
///
/// The mean of (p - p̄)(q - q̄)ᵀ, made symmetric, is stretched least along its normal.
fn best_mirror(pairs: &[Pair]) -> Option<MirrorPlane> {
    if pairs.len() < 10 {
        return None;
    }
    let (p, q) = (mean_of(pairs, |pair| pair.from)?, mean_of(pairs, |pair| pair.to)?);
    let both: Matrix3<f64> = pairs.iter().map(|pair| (pair.from - p) * (pair.to - q).transpose()).sum();
    let eigen = SymmetricEigen::new(both + both.transpose());
    let normal: Vector = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    let plane = MirrorPlane { normal, offset: normal.dot(&(p.coords + q.coords)) / 2.0, off_mm: f64::INFINITY };
    (plane.offset.is_finite() && normal.norm() > 0.5).then_some(plane)
}
