//! Autorotation of the mandible about its condyles.

use nalgebra::{Translation3, Unit, UnitQuaternion};

use super::tuning::{MAX_AUTOROTATION_RAD, PATH_SAMPLES};
use super::{Path, PlanError};
use prosopon_geometry::{Motion, Point, Vector};

/// Axis from the right to the left condyle; positive (right-handed) angles about it open the mouth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CondylarAxis {
    /// Right condyle, LPS mm.
    pub right: Point,
    /// Left condyle, LPS mm.
    pub left: Point,
}

impl CondylarAxis {
    /// Rotation about the axis by `angle`, radian.
    ///
    /// # Errors
    /// [`PlanError::Value`] when the condyles are less than 1 mm apart or not finite.
    pub fn turn(&self, angle: f64) -> Result<Motion, PlanError> {
        let axis = self.left - self.right;
        if !(axis.norm() >= 1.0 && axis.norm().is_finite()) {
            let detail = format!("are {:.1} mm apart, an axis needs at least 1 mm; check both points", axis.norm());
            return Err(PlanError::Value { what: "condyles".into(), detail });
        }
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle);
        Ok(Motion::from_parts(Translation3::from(self.right - turn * self.right), turn))
    }

    /// Path of the mandible that keeps the lower incisors as far below the upper ones as at rest.
    ///
    /// The upper jaw moves along `jaw_path`, the mandible is `segment`. At each sampled t the mandible turns about the axis
    /// until the point `lower` has risen as much as the point `upper`; both are given at rest, heights are along `up`. With `r` from
    /// the axis to `lower`, `a = r·up`, `b = (axis × r)·up` and the rise `d`, the angle solves `a cos θ + b sin θ = a + d`; the
    /// solution of smaller magnitude is taken. Between samples the angle changes in proportion to t.
    ///
    /// # Errors
    /// [`PlanError::Value`] when no rotation within 0.8 rad (46°) reaches that height, or the condyles are less than 1 mm apart.
    pub fn follow(
        &self,
        segment: u32,
        jaw_path: &Path,
        upper: &Point,
        lower: &Point,
        up: &Vector,
    ) -> Result<Path, PlanError> {
        self.turn(0.0)?;
        let axis = (self.left - self.right).normalize();
        let arm = lower - self.right;
        let arm = arm - axis * axis.dot(&arm);
        let (a, b) = (arm.dot(up), axis.cross(&arm).dot(up));
        let angle = |t: f64| {
            let rise = (jaw_path.at(t) * upper - upper).dot(up);
            let share = (a + rise) / a.hypot(b);
            let (middle, off) = (b.atan2(a), share.clamp(-1.0, 1.0).acos());
            let near = |x: f64| (x + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
            let (one, two) = (near(middle + off), near(middle - off));
            let found = if one.abs() < two.abs() { one } else { two };
            if share.abs() <= 1.0 && found.abs() <= MAX_AUTOROTATION_RAD {
                return Ok(found);
            }
            let detail = format!(
                "at t = {t} the upper incisor rises by {rise:.1} mm, and no rotation of the mandible within 46° lets the lower \
                 incisor follow; reduce the vertical movement of the upper jaw"
            );
            Err(PlanError::Value { what: "autorotate".into(), detail })
        };
        let mut times: Vec<f64> = (1..=PATH_SAMPLES).map(|i| i as f64 / PATH_SAMPLES as f64).collect();
        times.extend(jaw_path.waypoints().iter().map(|w| w.0).filter(|t| *t > 0.0));
        times.sort_by(f64::total_cmp);
        times.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        // `Path::new` needs a last t of exactly 1.
        if let Some(last) = times.last_mut() {
            *last = 1.0;
        }
        let waypoints = times.into_iter().map(|t| Ok((t, self.turn(angle(t)?)?))).collect::<Result<_, PlanError>>()?;
        Path::new(segment, waypoints)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: CondylarAxis = CondylarAxis { right: Point::new(-48.0, 3.0, 53.0), left: Point::new(58.0, 2.0, 53.0) };

    #[test]
    fn a_positive_turn_opens_the_mouth() {
        let incisor = Point::new(6.0, -78.0, 17.0);
        assert!((AXIS.turn(0.1).unwrap() * incisor).z < incisor.z - 5.0);
        assert!((AXIS.turn(0.3).unwrap() * AXIS.left - AXIS.left).norm() < 1e-12);
        assert!(CondylarAxis { left: AXIS.right, ..AXIS }.turn(0.1).is_err());
    }

    #[test]
    fn the_lower_incisor_rises_and_falls_with_the_upper() {
        let (upper, lower) = (Point::new(6.0, -80.0, 16.0), Point::new(6.0, -77.0, 18.0));
        let impaction = Motion::translation(0.0, -3.0, 4.0);
        let jaw_path = Path::new(1, vec![(0.37, Motion::translation(0.0, -3.0, -2.0)), (1.0, impaction)]).unwrap();
        let path = AXIS.follow(2, &jaw_path, &upper, &lower, &Vector::z()).unwrap();
        for (t, tolerance) in [(0.37, 1e-9), (0.5, 1e-9), (1.0, 1e-9), (0.85, 0.02)] {
            let (rise, follows) = ((jaw_path.at(t) * upper - upper).z, (path.at(t) * lower - lower).z);
            assert!((rise - follows).abs() < tolerance, "at {t}: {rise} and {follows}");
        }
        // A lever of some 87 mm that rises 4 mm from 24° below: about 2.9°.
        let angle = path.at(1.0).rotation.angle().to_degrees();
        assert!((2.5..3.2).contains(&angle), "{angle}");
        let far = Path::new(1, vec![(1.0, Motion::translation(0.0, 0.0, 95.0))]).unwrap();
        assert!(AXIS.follow(2, &far, &upper, &lower, &Vector::z()).is_err());
    }
}
