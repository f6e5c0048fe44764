//! The linear step of point-to-plane registration.

use nalgebra::{Matrix6, SymmetricEigen, Translation3, UnitQuaternion, Vector6};

use super::{EvaluateError, RegistrationFault};
use prosopon_geometry::{Motion, Point, Vector};

/// Fewer pairs than unknowns fix nothing.
const LEAST_PAIRS: usize = 6;
/// The equations of one step can be solved above this.
const SOLVABLE: f64 = 1e-9;

/// A point held along a normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) point: Point,
    /// Unit.
    pub(super) normal: Vector,
    /// Area that the point stands for, mm².
    pub(super) weight: f64,
}

/// A point and how far along the normal it lies from its partner, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub(super) row: Row,
    pub(super) gap: f64,
}

/// Middle and radius: turns about the middle, measured at the radius, are mm like shifts.
struct Frame {
    centre: Point,
    radius: f64,
}

impl Frame {
    fn of<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Self {
        let total = rows.clone().map(|r| r.weight).sum::<f64>().max(f64::MIN_POSITIVE);
        let centre = Point::from(rows.clone().map(|r| r.point.coords * r.weight).sum::<Vector>() / total);
        let square = rows.map(|r| r.weight * (r.point - centre).norm_squared()).sum::<f64>() / total;
        Self { centre, radius: square.sqrt().max(1e-9) }
    }

    /// Movement along the row's normal for each of three turns and three shifts.
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

/// Least against largest; 0 for no stiffness at all.
fn ratio(eigen: &SymmetricEigen<f64, nalgebra::U6>) -> f64 {
    let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
    if high > 0.0 && low.is_finite() { (low / high).max(0.0) } else { 0.0 }
}

/// Stiffness of the softest rigid motion of the rows against the stiffest, 0 to 1.
pub(super) fn stiffness(rows: &[Row]) -> f64 {
    ratio(&Frame::of(rows.iter()).stiffnesses(rows.iter()))
}

/// The small motion that minimises the squared gaps, and how far it moves a point, mm.
///
/// # Errors
/// [`RegistrationFault::NoPartners`] and [`RegistrationFault::Slides`].
pub(super) fn solve(pairs: &[Pair]) -> Result<(Motion, f64), EvaluateError> {
    if pairs.len() < LEAST_PAIRS {
        return Err(RegistrationFault::NoPartners { found: pairs.len(), allowed: LEAST_PAIRS }.into());
    }
    let rows = pairs.iter().map(|p| &p.row);
    let frame = Frame::of(rows.clone());
    let eigen = frame.stiffnesses(rows);
    let stiffness = ratio(&eigen);
    if stiffness <= SOLVABLE {
        return Err(RegistrationFault::Slides { stiffness, allowed: SOLVABLE }.into());
    }
    let right = -pairs.iter().map(|p| frame.row(&p.row) * (p.gap * p.row.weight)).sum::<Vector6<f64>>();
    let x = eigen.eigenvectors * (eigen.eigenvectors.transpose() * right).component_div(&eigen.eigenvalues);
    let (turn, shift) = (Vector::new(x[0], x[1], x[2]), Vector::new(x[3], x[4], x[5]));
    let rotation = UnitQuaternion::from_scaled_axis(turn / frame.radius);
    let translation = frame.centre.coords - rotation * frame.centre.coords + shift;
    Ok((Motion::from_parts(Translation3::from(translation), rotation), turn.norm() + shift.norm()))
}
