use super::super::tuning::{MAX_SLIT_BEND, MAX_SLIT_DEPTH_MM, MIN_SLIT_DEPTH_MM, MIN_SLIT_WIDTH_MM};
use prosopon_geometry::Point;

/// A place on the slit, seen from in front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlitKnot {
    /// Place on the skin where the lips meet, LPS mm.
    pub front: Point,
    /// y at which the lips end behind, at teeth or in the vestibule, mm.
    pub back_y: f64,
}

prosopon_geometry::flat!(SlitKnot { front, back_y });

/// Why a curve is no slit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SlitError {
    /// Fewer than three places, or one that is not finite.
    #[error("the slit has {found} usable places, at least 3 are needed")]
    Knots {
        /// Number of places.
        found: usize,
    },
    /// Places that do not run from one side to the other.
    #[error("place {index} of the slit does not lie farther to the left than the one before it")]
    Order {
        /// Index of the place.
        index: usize,
    },
    /// Too narrow to be meshed.
    #[error("the slit is {width_mm:.1} mm wide, at least {MIN_SLIT_WIDTH_MM} mm are needed")]
    Narrow {
        /// Distance of its ends along x, mm.
        width_mm: f64,
    },
    /// A place whose end behind is not behind its front, or too far behind it.
    #[error(
        "place {index} of the slit ends {depth_mm:.1} mm behind the skin, allowed are {MIN_SLIT_DEPTH_MM} to \
         {MAX_SLIT_DEPTH_MM} mm"
    )]
    Depth {
        /// Index of the place.
        index: usize,
        /// Distance from the skin to the end behind, mm.
        depth_mm: f64,
    },
    /// A curve that rises or falls too steeply.
    #[error(
        "the slit rises or falls by {rise:.1} mm for each mm to the side at place {index}, at most {MAX_SLIT_BEND}"
    )]
    Steep {
        /// Index of the place.
        index: usize,
        /// Change of z for each mm along x.
        rise: f64,
    },
}

/// The surface along which closed lips touch: `z = height(x)`, from the skin back to the teeth.
///
/// x is the patient's left, y is posterior and z is superior, mm. The height and the end behind are smooth curves through the
/// knots (cubic Hermite with the slopes of the neighbours' chords), straight beyond the first and the last knot.
#[derive(Debug, Clone, PartialEq)]
pub struct Slit {
    knots: Vec<SlitKnot>,
    heights: Curve,
    backs: Curve,
    fronts: Curve,
}

prosopon_geometry::flat!(Slit { knots, heights, backs, fronts });

impl Slit {
    /// The slit through knots from the right commissure to the left one, or from left to right.
    ///
    /// # Errors
    /// [`SlitError`].
    pub fn new(mut knots: Vec<SlitKnot>) -> Result<Self, SlitError> {
        let usable = knots.iter().filter(|k| k.front.iter().all(|c| c.is_finite()) && k.back_y.is_finite()).count();
        if usable < 3 || usable < knots.len() {
            return Err(SlitError::Knots { found: usable });
        }
        if let [first, .., last] = &knots[..]
            && first.front.x > last.front.x
        {
            knots.reverse();
        }
        if let Some(at) = knots.windows(2).position(|w| w[1].front.x <= w[0].front.x) {
            return Err(SlitError::Order { index: at + 1 });
        }
        let span = |k: &[SlitKnot]| k.last().map_or(0.0, |l| l.front.x) - k.first().map_or(0.0, |f| f.front.x);
        let width_mm = span(&knots);
        if width_mm < MIN_SLIT_WIDTH_MM {
            return Err(SlitError::Narrow { width_mm });
        }
        for (index, k) in knots.iter().enumerate() {
            let depth_mm = k.back_y - k.front.y;
            if !(MIN_SLIT_DEPTH_MM..=MAX_SLIT_DEPTH_MM).contains(&depth_mm) {
                return Err(SlitError::Depth { index, depth_mm });
            }
        }
        let curve = |of: fn(&SlitKnot) -> f64| Curve::through(knots.iter().map(|k| [k.front.x, of(k)]).collect());
        let (heights, backs, fronts) = (curve(|k| k.front.z), curve(|k| k.back_y), curve(|k| k.front.y));
        if let Some(index) = heights.slopes.iter().position(|s| s.abs() > MAX_SLIT_BEND) {
            return Err(SlitError::Steep { index, rise: heights.slopes[index] });
        }
        Ok(Self { knots, heights, backs, fronts })
    }

    /// The knots, from the right commissure to the left one.
    #[must_use]
    pub fn knots(&self) -> &[SlitKnot] {
        &self.knots
    }

    /// x of the right and the left commissure, mm.
    #[must_use]
    pub fn span(&self) -> [f64; 2] {
        let x = |k: Option<&SlitKnot>| k.map_or(0.0, |k| k.front.x);
        [x(self.knots.first()), x(self.knots.last())]
    }

    /// Height of `p` above the slit's surface, mm; positive at the upper lip.
    #[must_use]
    pub fn height(&self, p: &Point) -> f64 {
        p.z - self.heights.at(p.x).0
    }

    /// y of the skin at the slit, mm.
    #[must_use]
    pub fn front_y(&self, x: f64) -> f64 {
        self.fronts.at(x).0
    }

    /// y at which the lips end behind, mm.
    #[must_use]
    pub fn back_y(&self, x: f64) -> f64 {
        self.backs.at(x).0
    }

    /// Height of the surface and its slope along x.
    pub(super) fn surface_z(&self, x: f64) -> (f64, f64) {
        self.heights.at(x)
    }

    /// End behind and its slope along x.
    pub(super) fn back(&self, x: f64) -> (f64, f64) {
        self.backs.at(x)
    }
}

/// A cubic Hermite spline over x.
#[derive(Debug, Clone, PartialEq)]
struct Curve {
    points: Vec<[f64; 2]>,
    slopes: Vec<f64>,
}

prosopon_geometry::flat!(Curve { points, slopes });

impl Curve {
    /// Through at least two points with rising x.
    fn through(points: Vec<[f64; 2]>) -> Self {
        let n = points.len();
        let slope = |i: usize| {
            let (a, b) = (points[i.saturating_sub(1)], points[(i + 1).min(n - 1)]);
            (b[1] - a[1]) / (b[0] - a[0])
        };
        let slopes = (0..n).map(slope).collect();
        Self { points, slopes }
    }

    /// Value and slope at `x`.
    fn at(&self, x: f64) -> (f64, f64) {
        let next = self.points.partition_point(|p| p[0] <= x);
        if next == 0 || next == self.points.len() {
            let end = next.saturating_sub(1);
            let ([x0, y0], slope) = (self.points[end], self.slopes[end]);
            return (y0 + slope * (x - x0), slope);
        }
        let ([x0, y0], [x1, y1]) = (self.points[next - 1], self.points[next]);
        let (h, m0, m1) = (x1 - x0, self.slopes[next - 1], self.slopes[next]);
        let t = (x - x0) / h;
        let (t2, t3) = (t * t, t * t * t);
        let value = (2.0 * t3 - 3.0 * t2 + 1.0) * y0
            + (t3 - 2.0 * t2 + t) * h * m0
            + (3.0 * t2 - 2.0 * t3) * y1
            + (t3 - t2) * h * m1;
        let slope = (6.0 * t2 - 6.0 * t) * (y0 - y1) / h + (3.0 * t2 - 4.0 * t + 1.0) * m0 + (3.0 * t2 - 2.0 * t) * m1;
        (value, slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knot(x: f64, z: f64) -> SlitKnot {
        SlitKnot { front: Point::new(x, -90.0, z), back_y: -80.0 }
    }

    #[test]
    fn a_slit_runs_through_its_knots_with_the_slope_of_its_value() {
        let knots = vec![knot(-20.0, 1.0), knot(-8.0, 2.0), knot(1.0, 2.5), knot(22.0, 0.5)];
        let slit = Slit::new(knots.clone()).unwrap();
        assert_eq!(Slit::new(knots.iter().rev().copied().collect()).unwrap(), slit);
        assert_eq!(slit.span(), [-20.0, 22.0]);
        for k in &knots {
            assert!(slit.height(&k.front).abs() < 1e-12);
        }
        for x in [-25.0, -19.0, -8.5, 0.0, 14.0, 30.0] {
            let h = 1e-5;
            let slope = (slit.surface_z(x + h).0 - slit.surface_z(x - h).0) / (2.0 * h);
            assert!((slope - slit.surface_z(x).1).abs() < 1e-7, "{x}");
        }
    }

    #[test]
    fn curves_that_are_no_slit_are_refused_with_the_reason() {
        let fault = |knots: Vec<SlitKnot>| Slit::new(knots).unwrap_err();
        assert_eq!(fault(vec![knot(0.0, 0.0), knot(30.0, 0.0)]), SlitError::Knots { found: 2 });
        assert_eq!(fault(vec![knot(0.0, 0.0), knot(9.0, f64::NAN), knot(30.0, 0.0)]), SlitError::Knots { found: 2 });
        assert_eq!(fault(vec![knot(0.0, 0.0), knot(40.0, 0.0), knot(30.0, 0.0)]), SlitError::Order { index: 2 });
        assert_eq!(fault(vec![knot(0.0, 0.0), knot(2.0, 0.0), knot(4.0, 0.0)]), SlitError::Narrow { width_mm: 4.0 });
        let deep = SlitKnot { back_y: -20.0, ..knot(20.0, 0.0) };
        assert_eq!(fault(vec![knot(0.0, 0.0), deep, knot(40.0, 0.0)]), SlitError::Depth { index: 1, depth_mm: 70.0 });
        let steep = fault(vec![knot(0.0, 0.0), knot(10.0, 20.0), knot(40.0, 0.0)]);
        assert_eq!(steep, SlitError::Steep { index: 0, rise: 2.0 });
    }
}
