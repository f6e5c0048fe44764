//! Rigid paths through waypoints, joined by screw motions.

use nalgebra::{Translation3, UnitQuaternion};

use super::PlanError;
use prosopon_geometry::{Motion, Point, Vector};

/// Rigid path of one segment: waypoints at rising `t` from 0 to 1, joined by screw motions.
///
/// ```
/// use prosopon_geometry::{Motion, Point};
/// use prosopon_planning::plan::Path;
///
/// // Segment 1 moves 5 mm forward (-y) and 2 mm up (+z).
/// let path = Path::new(1, vec![(1.0, Motion::translation(0.0, -5.0, 2.0))])?;
/// let incisor = Point::new(0.0, -80.0, 20.0);
/// assert!((path.at(0.5) * incisor - Point::new(0.0, -82.5, 21.0)).norm() < 1e-12);
/// assert!((path.length_mm(&incisor) - 29f64.sqrt()).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    segment: u32,
    waypoints: Vec<(f64, Motion)>,
}

impl Path {
    /// Path of `segment` through the waypoints `(t, motion from rest)`.
    ///
    /// A waypoint at t = 0 with the identity is added when none is given.
    ///
    /// # Errors
    /// [`PlanError::Value`] when t does not rise, lies outside \[0, 1\] or does not end at 1, when a motion is not finite, or
    /// when a waypoint at t = 0 is not the identity: the segment starts at rest.
    pub fn new(segment: u32, mut waypoints: Vec<(f64, Motion)>) -> Result<Self, PlanError> {
        let fault = |what: String, detail: String| Err(PlanError::Value { what, detail });
        let mut last = None;
        for (i, (t, motion)) in waypoints.iter().enumerate() {
            if !(0.0..=1.0).contains(t) {
                return fault(format!("waypoints[{i}].t"), format!("is {t}, allowed is 0 to 1"));
            }
            if let Some(before) = last
                && *t <= before
            {
                return fault(format!("waypoints[{i}].t"), format!("is {t}, must be above the previous t = {before}"));
            }
            last = Some(*t);
            if !motion.to_homogeneous().iter().all(|c| c.is_finite()) {
                return fault(format!("waypoints[{i}]"), "the motion has a value that is not finite".into());
            }
            let off = motion.translation.vector.norm() + motion.rotation.angle();
            if *t == 0.0 && off > 1e-9 {
                return fault(
                    format!("waypoints[{i}]"),
                    "at t = 0 the segment is at rest: no motion is allowed".into(),
                );
            }
        }
        match last {
            Some(1.0) => {}
            Some(t) => return fault("waypoints".into(), format!("the last t is {t}, must be 1")),
            None => return fault("waypoints".into(), "are missing; at least one, at t = 1, is needed".into()),
        }
        match waypoints.first_mut() {
            Some(first) if first.0 == 0.0 => first.1 = Motion::identity(),
            _ => waypoints.insert(0, (0.0, Motion::identity())),
        }
        Ok(Self { segment, waypoints })
    }

    /// Number of the segment that moves.
    #[must_use]
    pub fn segment(&self) -> u32 {
        self.segment
    }

    /// The waypoints `(t, motion from rest)`, ascending; the first is at t = 0, the last at t = 1.
    #[must_use]
    pub fn waypoints(&self) -> &[(f64, Motion)] {
        &self.waypoints
    }

    /// The same path in another frame, into which `motion` maps.
    #[must_use]
    pub fn seen_from(&self, motion: &Motion) -> Self {
        let back = motion.inverse();
        let waypoints = self.waypoints.iter().map(|(t, m)| (*t, motion * m * back)).collect();
        Self { segment: self.segment, waypoints }
    }

    /// Motion from rest at `t`, which is clamped to \[0, 1\].
    ///
    /// Between two waypoints it is a screw motion, with the rotation of at most half a revolution.
    #[must_use]
    pub fn at(&self, t: f64) -> Motion {
        let next = self.waypoints.partition_point(|w| w.0 <= t);
        if next == 0 {
            return self.waypoints[0].1;
        }
        let (ta, a) = self.waypoints[next - 1];
        match self.waypoints.get(next) {
            Some((tb, b)) => Screw::between(&a, b).at((t - ta) / (tb - ta)) * a,
            None => a,
        }
    }

    /// Exact length of the path of the point `rest`, given at rest (LPS mm), from t = 0 to 1, mm.
    #[must_use]
    pub fn length_mm(&self, rest: &Point) -> f64 {
        self.waypoints.windows(2).map(|w| Screw::between(&w[0].1, &w[1].1).arc(&(w[0].1 * rest))).sum()
    }
}

/// Paths of all segments that move.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// One path for each moving segment.
    pub paths: Vec<Path>,
}

impl Plan {
    /// Motions of all moving segments at `t`.
    #[must_use]
    pub fn motions(&self, t: f64) -> Vec<(u32, Motion)> {
        self.paths.iter().map(|p| (p.segment(), p.at(t))).collect()
    }

    /// The same plan in another frame, into which `motion` maps.
    #[must_use]
    pub fn seen_from(&self, motion: &Motion) -> Self {
        Self { paths: self.paths.iter().map(|path| path.seen_from(motion)).collect() }
    }

    /// Plan that leads straight from the motions `now` to the end of this plan.
    ///
    /// Each segment moves by one screw motion. Segments that `now` does not list start at rest.
    #[must_use]
    pub fn continued_from(&self, now: &[(u32, Motion)]) -> Self {
        let begin = |segment| now.iter().find(|(s, _)| *s == segment).map_or_else(Motion::identity, |(_, m)| *m);
        let straight = |path: &Path| Path {
            segment: path.segment,
            waypoints: vec![(0.0, begin(path.segment)), (1.0, path.at(1.0))],
        };
        Self { paths: self.paths.iter().map(straight).collect() }
    }
}

/// Relative motion `x -> R x + p` as a rotation about an axis and a translation along it.
struct Screw {
    /// Unit axis; any when `angle` is 0.
    axis: Vector,
    /// Rotation angle, radian, from 0 to π.
    angle: f64,
    /// Part of `p` along the axis, and across it.
    along: Vector,
    across: Vector,
}

impl Screw {
    fn between(a: &Motion, b: &Motion) -> Self {
        let relative = b * a.inverse();
        let p = relative.translation.vector;
        match relative.rotation.axis_angle() {
            Some((axis, angle)) => {
                let along = *axis * axis.dot(&p);
                Self { axis: *axis, angle, along, across: p - along }
            }
            None => Self { axis: Vector::z(), angle: 0.0, along: p, across: Vector::zeros() },
        }
    }

    /// The share `s` of the motion: `exp(s log M)`.
    ///
    /// Across the axis, with complex numbers in the plane, `p = (1 - e^{iθ}) c` for the axis point `c`, so
    /// `p(s) = (1 - e^{isθ}) c = sin(sθ/2)/sin(θ/2) · e^{i(s-1)θ/2} p`. That form has no cancellation for small θ, where
    /// `c` goes to infinity.
    fn at(&self, s: f64) -> Motion {
        let turn = |angle: f64| UnitQuaternion::from_scaled_axis(self.axis * angle);
        let half = 0.5 * self.angle;
        let ratio = if half > 0.0 { (s * half).sin() / half.sin() } else { s };
        let p = self.along * s + turn((s - 1.0) * half) * self.across * ratio;
        Motion::from_parts(Translation3::from(p), turn(s * self.angle))
    }

    /// Length of the helix on which the point `from` moves, mm.
    fn arc(&self, from: &Point) -> f64 {
        let chord = self.at(1.0) * from - from;
        let along = self.axis * self.axis.dot(&chord);
        let half = 0.5 * self.angle;
        // A chord spans the angle θ on its circle: arc = chord · (θ/2) / sin(θ/2).
        let bend = if half > 0.0 { half / half.sin() } else { 1.0 };
        along.norm().hypot((chord - along).norm() * bend)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    use super::*;

    fn about(axis: Vector, angle: f64, through: &Point, along: f64) -> Motion {
        let rotation = UnitQuaternion::from_scaled_axis(axis * angle);
        let shift = through - rotation * through + axis * along;
        Motion::from_parts(Translation3::from(shift), rotation)
    }

    fn difference(a: &Motion, b: &Motion) -> f64 {
        (a.to_homogeneous() - b.to_homogeneous()).abs().max()
    }

    #[test]
    fn half_of_a_quarter_turn_about_a_far_axis_is_an_eighth_about_the_same_axis() {
        let axis = Vector::new(1.0, 2.0, -0.5).normalize();
        let through = Point::new(40.0, -60.0, 10.0);
        let path = Path::new(1, vec![(1.0, about(axis, FRAC_PI_2, &through, 6.0))]).unwrap();
        assert!(difference(&path.at(0.5), &about(axis, FRAC_PI_4, &through, 3.0)) < 1e-12);
        assert!(difference(&path.at(0.25), &about(axis, FRAC_PI_4 / 2.0, &through, 1.5)) < 1e-12);
        assert_eq!(path.at(0.0), Motion::identity());
        assert_eq!(path.at(1.0), path.waypoints()[1].1);
    }

    #[test]
    fn translation_and_tiny_turns_are_smooth_limits() {
        let shift = Vector::new(3.0, -8.0, 1.0);
        let path = Path::new(1, vec![(1.0, Motion::from_parts(shift.into(), UnitQuaternion::identity()))]).unwrap();
        assert!((path.at(0.3).translation.vector - shift * 0.3).norm() < 1e-15);
        for angle in [1e-3, 1e-6, 1e-9, 1e-12] {
            let turned =
                Motion::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(Vector::new(0.0, 0.6, 0.8) * angle));
            let at = Path::new(1, vec![(1.0, turned)]).unwrap().at(0.5);
            // The chord's middle lies off the arc by about |shift| θ/8.
            assert!((at.translation.vector - shift * 0.5).norm() < 9.0 * angle + 1e-14);
        }
    }

    #[test]
    fn later_intervals_start_where_the_last_one_ended() {
        let a = about(Vector::x(), 0.3, &Point::new(1.0, 2.0, 3.0), 1.0);
        let b = about(Vector::y(), -0.9, &Point::new(-4.0, 0.0, 9.0), 0.0) * a;
        let path = Path::new(2, vec![(0.4, a), (1.0, b)]).unwrap();
        assert!(difference(&path.at(0.4), &a) < 1e-15);
        let middle = about(Vector::y(), -0.45, &Point::new(-4.0, 0.0, 9.0), 0.0) * a;
        assert!(difference(&path.at(0.7), &middle) < 1e-12);
        assert_eq!(path.at(f64::NAN), Motion::identity());
        assert_eq!(path.at(7.0), b);
    }

    #[test]
    fn the_length_of_a_helix_is_exact() {
        let path = Path::new(1, vec![(1.0, about(Vector::z(), FRAC_PI_2, &Point::new(5.0, 0.0, 0.0), 4.0))]).unwrap();
        let length = path.length_mm(&Point::new(15.0, 0.0, 0.0));
        assert!((length - (10.0 * FRAC_PI_2).hypot(4.0)).abs() < 1e-12);
    }

    #[test]
    fn faulty_waypoints_are_refused_by_place() {
        let still = Motion::identity();
        let moved = Motion::translation(1.0, 0.0, 0.0);
        let what = |waypoints| match Path::new(1, waypoints) {
            Err(PlanError::Value { what, .. }) => what,
            other => panic!("{other:?}"),
        };
        assert_eq!(what(vec![(0.5, still), (0.5, moved), (1.0, moved)]), "waypoints[1].t");
        assert_eq!(what(vec![(0.5, still), (1.5, moved)]), "waypoints[1].t");
        assert_eq!(what(vec![(f64::NAN, still)]), "waypoints[0].t");
        assert_eq!(what(vec![(0.5, moved)]), "waypoints");
        assert_eq!(what(vec![]), "waypoints");
        assert_eq!(what(vec![(0.0, moved), (1.0, moved)]), "waypoints[0]");
        assert_eq!(what(vec![(1.0, Motion::translation(f64::NAN, 0.0, 0.0))]), "waypoints[0]");
    }
}
