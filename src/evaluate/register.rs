//! Rigid registration of two surfaces.

use nalgebra::{Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector6};

use super::EvaluateError;
use super::distance::Surface;
use crate::control::Control;
use crate::geometry::{Motion, Point, TriMesh, Vector};

/// About this many source vertices are used, evenly picked by number.
const POINTS: usize = 8000;
const ITERATIONS: usize = 120;
/// While the surfaces come together, this share of the pairs is kept, the nearest.
const SHARE: f64 = 0.6;
/// That ends when no point moves farther than this any more, mm.
const TOGETHER_MM: f64 = 1e-3;
/// Then pairs farther apart than this many robust standard deviations are trimmed.
const TRIM: f64 = 2.5;
/// Never trim below this distance, mm: exact data would trim themselves away.
const TRIM_FLOOR_MM: f64 = 1e-3;
/// An update that moves no point farther than this ends the iteration, mm.
const STILL_MM: f64 = 1e-8;
/// Still accepted when the iterations run out: pairs that flip in and out of the trimmed set, mm.
const NEARLY_STILL_MM: f64 = 1e-3;
/// Surfaces whose median distance stays above this do not show the same body, mm.
const MATCH_MM: f64 = 5.0;
/// Least stiffness of a motion against the stiffest; below it the surface slides along itself.
const LEAST_STIFFNESS: f64 = 1e-6;

/// Rigid motion that brings `source` onto `target`, by trimmed point-to-plane ICP over the source vertices where `unaltered` holds.
///
/// Starts where the surfaces are; they should be no more than a few cm and some 20° apart. The nearest 60 % of the pairs
/// bring them together, so that a third of the surface may have changed. Then all pairs count that are nearer than 2.5
/// robust standard deviations (1.4826 times the median distance). Pairs on the target's open border never count.
///
/// # Errors
/// [`EvaluateError::Registration`] when it does not settle, the surfaces do not match, or they slide on each other (a
/// plane, a ball); [`EvaluateError::Input`] for a mask of another length or fewer than 6 vertices; cancellation.
///
/// # Source
/// Chen & Medioni, Object modelling by registration of multiple range images, 1992; Chetverikov, Stepanov & Krsek, Robust
/// Euclidean alignment of 3D point sets: the trimmed iterative closest point algorithm, 2005.
pub fn register(
    source: &TriMesh,
    target: &TriMesh,
    unaltered: Option<&[bool]>,
    control: &Control,
) -> Result<Motion, EvaluateError> {
    let n = source.positions().len();
    if let Some(mask) = unaltered
        && mask.len() != n
    {
        let detail = format!("the mask has {} entries, the surface {n} vertices", mask.len());
        return Err(EvaluateError::Input { detail });
    }
    let chosen: Vec<Point> =
        (0..n).filter(|v| unaltered.is_none_or(|m| m[*v])).map(|v| source.positions()[v]).collect();
    if chosen.len() < 6 {
        let detail = format!("only {} vertices are left to register, at least 6 are needed", chosen.len());
        return Err(EvaluateError::Input { detail });
    }
    let points: Vec<Point> = chosen.iter().copied().step_by(chosen.len().div_ceil(POINTS)).collect();
    let surface = Surface::new(target)?;
    let mut motion = Motion::identity();
    let mut last = f64::INFINITY;
    let mut median = f64::INFINITY;
    let mut together = false;
    for iteration in 0..ITERATIONS {
        control.check()?;
        control.report(iteration as f64 / ITERATIONS as f64);
        let moved: Vec<Point> = points.iter().map(|p| motion * p).collect();
        let hits = surface.all_nearest(&moved, control)?;
        let pairs: Vec<(Point, Vector, f64)> = moved
            .iter()
            .zip(&hits)
            .filter(|(_, hit)| !hit.on_border)
            .map(|(p, hit)| (*p, hit.normal, hit.normal.dot(&(p - hit.point))))
            .collect();
        let mut sizes: Vec<f64> = pairs.iter().map(|p| p.2.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        median = sizes.get(sizes.len() / 2).copied().unwrap_or(f64::INFINITY);
        let nearest = sizes.get((SHARE * sizes.len() as f64) as usize).copied().unwrap_or(f64::INFINITY);
        let limit = if together { TRIM * 1.4826 * median } else { nearest }.max(TRIM_FLOOR_MM);
        let kept: Vec<(Point, Vector, f64)> = pairs.into_iter().filter(|p| p.2.abs() <= limit).collect();
        let (update, step) = point_to_plane(&kept)?;
        motion = update * motion;
        last = step;
        if together && step < STILL_MM {
            break;
        }
        together |= step < TOGETHER_MM;
    }
    if !together || last > NEARLY_STILL_MM {
        let detail = format!("after {ITERATIONS} iterations points still move by {last:.3} mm");
        return Err(EvaluateError::Registration { detail });
    }
    if median > MATCH_MM {
        let detail = format!("the median distance stays at {median:.1} mm, at most {MATCH_MM} mm is allowed");
        return Err(EvaluateError::Registration { detail });
    }
    Ok(motion)
}

/// The small motion that minimises the squared distances along the normals, and how far it moves a point, mm.
/// Pairs: point, normal of the target, distance along it.
fn point_to_plane(pairs: &[(Point, Vector, f64)]) -> Result<(Motion, f64), EvaluateError> {
    if pairs.len() < 6 {
        let detail = format!("only {} vertices have a partner, at least 6 are needed", pairs.len());
        return Err(EvaluateError::Registration { detail });
    }
    let count = pairs.len() as f64;
    let centre = Point::from(pairs.iter().map(|p| p.0.coords).sum::<Vector>() / count);
    let radius = (pairs.iter().map(|p| (p.0 - centre).norm_squared()).sum::<f64>() / count).sqrt().max(1e-9);
    let (mut normal_matrix, mut right) = (Matrix6::zeros(), Vector6::zeros());
    for (p, n, d) in pairs {
        // Turns are scaled by the radius: all six unknowns are mm.
        let turn = (p - centre).cross(n) / radius;
        let row = Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z);
        normal_matrix += row * row.transpose();
        right -= row * *d;
    }
    let eigen = SymmetricEigen::new(normal_matrix);
    let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    if low.is_nan() || low <= LEAST_STIFFNESS * high {
        let detail = "the surfaces slide along each other: their shape does not fix the motion".into();
        return Err(EvaluateError::Registration { detail });
    }
    let x = eigen.eigenvectors * (eigen.eigenvectors.transpose() * right).component_div(&eigen.eigenvalues);
    let turn = Vector::new(x[0], x[1], x[2]);
    let shift = Vector::new(x[3], x[4], x[5]);
    let rotation = UnitQuaternion::from_scaled_axis(turn / radius);
    let translation = centre.coords - rotation * centre.coords + shift;
    Ok((Motion::from_parts(Translation3::from(translation), rotation), turn.norm() + shift.norm()))
}
