//! What would put landmarks onto their surfaces.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::change::Change;
use super::places::{Judged, Surfaces};
use super::pose::Pose;
use super::tuning::{
    BEST_STARTS, BETTER_SHARE, FEWEST_JUDGED, FEWEST_SHIFTED, HEAD_SIZES, LEAST_SHIFT_MM, PLAIN_SHIFT_MM,
    SHIFT_ITERATIONS, SHIFT_STEP_MM, SHIFT_STEPS, SHIFTED_MM,
};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// Why landmarks lie off their surfaces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cause {
    /// Another frame, side or unit.
    Change(Change),
    /// A common shift onto the surfaces, mm.
    Shift(Vector),
}

impl Cause {
    /// Whether it is too large to be read off wrongly.
    pub(super) fn is_plain(&self) -> bool {
        match self {
            Self::Change(_) => true,
            Self::Shift(by) => by.norm() > PLAIN_SHIFT_MM,
        }
    }

    /// The point where it would lie.
    pub(super) fn apply(&self, p: &Point) -> Point {
        match self {
            Self::Change(change) => change.apply(p),
            Self::Shift(by) => p + by,
        }
    }
}

/// How well landmarks lie on their surfaces after a change.
#[derive(Debug, Clone, Copy)]
struct Fit {
    off: usize,
    mean_mm: f64,
}

fn fit(surfaces: &Surfaces, judged: &[Judged<'_>], moved: &dyn Fn(&Point) -> Point) -> Fit {
    let distances = judged.iter().filter_map(|j| surfaces.distance(&j.known, &moved(&j.point)));
    let (mut off, mut sum, mut n) = (0, 0.0, 0usize);
    for distance in distances {
        off += usize::from(distance.is_off());
        sum += distance.mm;
        n += 1;
    }
    Fit { off, mean_mm: sum / n.max(1) as f64 }
}

/// The likeliest cause that puts nine tenths of the landmarks onto their surfaces; `None` when none does.
pub(super) fn cause(
    surfaces: &Surfaces,
    judged: &[Judged<'_>],
    pose: Option<&Pose>,
    boxes: &[&TriMesh],
) -> Option<Cause> {
    if judged.len() < FEWEST_JUDGED {
        return None;
    }
    let given = fit(surfaces, judged, &|p| *p);
    let is_good = |f: &Fit| f.off * 10 <= judged.len() && f.mean_mm <= BETTER_SHARE * given.mean_mm;
    let sized = |c: &Change| pose.is_none_or(|pose| (HEAD_SIZES[0]..HEAD_SIZES[1]).contains(&(pose.size * c.factor)));
    let fitted = |c: Change| (c, fit(surfaces, judged, &|p| c.apply(p)));
    let changes = Change::all().filter(sized).map(fitted).filter(|(_, f)| is_good(f));
    let best = changes.min_by(|a, b| a.1.off.cmp(&b.1.off).then(a.1.mean_mm.total_cmp(&b.1.mean_mm)));
    if let Some((change, _)) = best {
        return Some(Cause::Change(change));
    }
    if judged.len() < FEWEST_SHIFTED {
        return None;
    }
    let mut begun: Vec<(f64, Vector)> = starts(judged, boxes)
        .into_par_iter()
        .map(|start| (fit(surfaces, judged, &|p| p + start).mean_mm, start))
        .collect();
    begun.sort_by(|a, b| a.0.total_cmp(&b.0));
    begun.truncate(BEST_STARTS);
    let found: Vec<(Vector, Fit)> = begun
        .into_par_iter()
        .map(|(_, start)| {
            let by = shifted(surfaces, judged, start);
            (by, fit(surfaces, judged, &|p| p + by))
        })
        .collect();
    let good = found.into_iter().filter(|(by, f)| is_good(f) && f.mean_mm <= SHIFTED_MM && by.norm() > LEAST_SHIFT_MM);
    good.min_by(|a, b| a.1.mean_mm.total_cmp(&b.1.mean_mm)).map(|(by, _)| Cause::Shift(by))
}

/// Shifts from which the search begins: none, and landmarks before the middle of the surfaces, with steps along the axes.
fn starts(judged: &[Judged<'_>], meshes: &[&TriMesh]) -> Vec<Vector> {
    let points: Vec<Point> = judged.iter().map(|j| j.point).collect();
    let Some(own) = Aabb::of(&points) else { return Vec::new() };
    let steps = (-SHIFT_STEPS..=SHIFT_STEPS).map(|k| f64::from(k) * SHIFT_STEP_MM);
    let mut starts: Vec<Vector> = Vec::new();
    for axis in 0..3 {
        starts.extend(steps.clone().map(|mm| Vector::ith(axis, mm)));
    }
    for mesh in meshes {
        let whole = mesh.bounds();
        let to_middle = whole.center() - own.center();
        let base = Vector::new(to_middle.x, whole.min.y - own.min.y, to_middle.z);
        starts.extend(steps.clone().map(|mm| base + Vector::new(0.0, 0.0, mm)));
    }
    starts
}

/// The shift near `start` that brings the points closest to their surfaces, point to plane.
fn shifted(surfaces: &Surfaces, judged: &[Judged<'_>], start: Vector) -> Vector {
    /// Share of a full step that is held back along directions that no surface determines.
    const DAMPING: f64 = 0.03;
    let mut by = start;
    for _ in 0..SHIFT_ITERATIONS {
        let (mut matrix, mut right) = (Matrix3::identity() * DAMPING, Vector::zeros());
        for j in judged {
            let p = j.point + by;
            let Some(distance) = surfaces.distance(&j.known, &p) else { continue };
            let away = p - distance.closest;
            let Some(normal) = away.try_normalize(1e-6) else { continue };
            matrix += normal * normal.transpose() / judged.len() as f64;
            right -= away / judged.len() as f64;
        }
        let Some(step) = matrix.lu().solve(&right) else { break };
        by += step;
        if step.norm() < 0.05 {
            break;
        }
    }
    by
}
