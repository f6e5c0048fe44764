//! The linear step of point-to-plane registration.

use nalgebra::{Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector6};

use super::tuning::{MIN_PAIRS, SOLVABLE};
use super::{EvaluateError, RegistrationFault};
use prosopon_geometry::{Motion, Point, Vector};

/// A point constrained along a normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) point: Point,
    /// Unit normal.
    pub(super) normal: Vector,
    /// Area that the point represents, mm².
    pub(super) weight: f64,
}

/// A constrained point and its signed distance along the normal from its closest point, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub(super) row: Row,
    pub(super) gap: f64,
}

/// Centroid and radius.
/// Rotations about the centroid are measured at the radius, so that they are in mm like translations.
struct RowFrame {
    centre: Point,
    radius: f64,
}

impl RowFrame {
    fn of<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Self {
        let total = rows.clone().map(|r| r.weight).sum::<f64>().max(f64::MIN_POSITIVE);
        let centre = Point::from(rows.clone().map(|r| r.point.coords * r.weight).sum::<Vector>() / total);
        let square = rows.map(|r| r.weight * (r.point - centre).norm_squared()).sum::<f64>() / total;
        Self { centre, radius: square.sqrt().max(1e-9) }
    }

    /// Movement along the row's normal for each of three rotations and three translations.
    fn row(&self, r: &Row) -> Vector6<f64> {
        let turn = (r.point - self.centre).cross(&r.normal) / self.radius;
        Vector6::new(turn.x, turn.y, turn.z, r.normal.x, r.normal.y, r.normal.z)
    }

    fn stiffnesses<'a>(&self, rows: impl Iterator<Item = &'a Row>) -> SymmetricEigen<f64, nalgebra::U6> {
        let mut matrix = Matrix6::zeros();
        for r in rows {
            let row = self.row(r);
            matrix += row * row.transpose() * r.weight;
        }
        SymmetricEigen::new(matrix)
    }
}

/// Smallest eigenvalue over the largest; 0 when all are 0.
fn ratio(eigen: &SymmetricEigen<f64, nalgebra::U6>) -> f64 {
    let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    if high > 0.0 && low.is_finite() { (low / high).max(0.0) } else { 0.0 }
}

/// Stiffness of the softest rigid motion of the rows relative to the stiffest one, 0 to 1.
pub(super) fn stiffness(rows: &[Row]) -> f64 {
    ratio(&RowFrame::of(rows.iter()).stiffnesses(rows.iter()))
}

/// A small motion.
pub(super) struct Step {
    pub(super) motion: Motion,
    /// Largest movement of a point, mm.
    pub(super) movement_mm: f64,
}

/// The small motion that minimises the squared gaps.
///
/// # Errors
/// [`RegistrationFault::TooFewPairs`] with too few pairs, [`RegistrationFault::ShapeUndetermined`] when the equations are singular.
pub(super) fn solve(pairs: &[Pair]) -> Result<Step, EvaluateError> {
    if pairs.len() < MIN_PAIRS {
        return Err(RegistrationFault::TooFewPairs { found: pairs.len(), allowed: MIN_PAIRS }.into());
    }
    let rows = pairs.iter().map(|p| &p.row);
    let frame = RowFrame::of(rows.clone());
    let eigen = frame.stiffnesses(rows);
    let stiffness = ratio(&eigen);
    if stiffness <= SOLVABLE {
        return Err(RegistrationFault::ShapeUndetermined { stiffness, allowed: SOLVABLE }.into());
    }
    let right = -pairs.iter().map(|p| frame.row(&p.row) * (p.gap * p.row.weight)).sum::<Vector6<f64>>();
    let x = eigen.eigenvectors * (eigen.eigenvectors.transpose() * right).component_div(&eigen.eigenvalues);
    let (turn, shift) = (Vector::new(x[0], x[1], x[2]), Vector::new(x[3], x[4], x[5]));
    let rotation = UnitQuaternion::from_scaled_axis(turn / frame.radius);
    let translation = frame.centre.coords - rotation * frame.centre.coords + shift;
    let motion = Motion::from_parts(Translation3::from(translation), rotation);
    Ok(Step { motion, movement_mm: turn.norm() + shift.norm() })
}
