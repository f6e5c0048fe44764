use super::super::tuning::{OPENING_EDGES, OPENING_REACH, OPENING_TAPER, PAST_BACK_MM};
use super::Slit;
use prosopon_geometry::{Point, Vector};

/// A map that pulls the tissue apart along a slit.
///
/// A point at height `h` above the slit's surface goes to `h + sign(h) A(x, y) w(|h|)`, along z alone. `A` is the half opening:
/// constant inside, falling in a straight line to 0 at the commissures and behind the teeth. `w(t) = (1 - (t/R)²)²` ends at the
/// reach R. The slope of the map along z stays above 0.74, so the map has an inverse.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct Opening<'a> {
    pub(super) slit: &'a Slit,
    /// Largest half opening, mm.
    half: f64,
    /// Height beyond which nothing moves, mm.
    reach: f64,
}

/// Place of a point before the opening, with its derivatives.
pub(super) struct Closed {
    pub(super) point: Point,
    /// Gradient of its z by the place after the opening.
    pub(super) z_gradient: Vector,
}

/// The map back at a point that it moves.
struct Closing {
    point: Point,
    /// Gradient of the z before, in tissue.
    z_gradient: Vector,
    /// Slope of the slit's surface along x.
    slope: f64,
    in_gap: bool,
}

impl<'a> Opening<'a> {
    /// An opening that a lattice with this edge resolves, mm.
    pub(in super::super) fn new(slit: &'a Slit, edge: f64) -> Self {
        Self::by(slit, OPENING_EDGES * edge)
    }

    /// An opening by `half` mm to either side.
    pub(super) fn by(slit: &'a Slit, half: f64) -> Self {
        Self { slit, half, reach: OPENING_REACH * half }
    }

    /// Half opening at (x, y), mm, and its gradient; it goes on below 0 outside the slit.
    fn half_opening(&self, x: f64, y: f64) -> (f64, Vector) {
        let [right, left] = self.slit.span();
        let (back, slope) = self.slit.back(x.clamp(right, left));
        let slope = if x < right || x > left { 0.0 } else { slope };
        let end = back + PAST_BACK_MM + self.half / OPENING_TAPER;
        let sides = [
            (self.half, Vector::zeros()),
            (OPENING_TAPER * (x - right), Vector::new(OPENING_TAPER, 0.0, 0.0)),
            (OPENING_TAPER * (left - x), Vector::new(-OPENING_TAPER, 0.0, 0.0)),
            (OPENING_TAPER * (end - y), Vector::new(OPENING_TAPER * slope, -OPENING_TAPER, 0.0)),
        ];
        sides.into_iter().fold((f64::INFINITY, Vector::zeros()), |a, b| if b.0 < a.0 { b } else { a })
    }

    /// Share of the half opening by which a point at a distance from the slit moves, and its slope.
    fn share(&self, distance: f64) -> (f64, f64) {
        let u = distance / self.reach;
        if u >= 1.0 {
            return (0.0, 0.0);
        }
        let v = 1.0 - u * u;
        (v * v, -4.0 * u * v / self.reach)
    }

    /// Distance from the slit before the opening of a point at `distance` after it, where the half opening is `a`.
    fn distance_before(&self, distance: f64, a: f64) -> f64 {
        if distance <= a {
            return 0.0;
        }
        let mut t = distance - a;
        for _ in 0..50 {
            let (w, slope) = self.share(t);
            let step = (t + a * w - distance) / (1.0 + a * slope);
            t -= step;
            if step.abs() < 1e-13 * self.reach {
                break;
            }
        }
        t
    }

    /// Signed depth in the opened gap, mm: positive inside it, negative in tissue; and its gradient.
    pub(in super::super) fn gap(&self, p: &Point) -> (f64, Vector) {
        let (z, slope) = self.slit.surface_z(p.x);
        let (a, gradient) = self.half_opening(p.x, p.y);
        let height = p.z - z;
        let sign = if height < 0.0 { -1.0 } else { 1.0 };
        (a - height.abs(), gradient - Vector::new(-slope, 0.0, 1.0) * sign)
    }

    /// Place before the opening of a point after it.
    pub(super) fn closed_with_gradient(&self, p: &Point) -> Closed {
        match self.closing(p) {
            None => Closed { point: *p, z_gradient: Vector::z() },
            // The whole gap closes to the slit's surface.
            Some(c) if c.in_gap => Closed { point: c.point, z_gradient: Vector::new(c.slope, 0.0, 0.0) },
            Some(c) => Closed { point: c.point, z_gradient: c.z_gradient },
        }
    }

    /// Normal of a surface before the opening, from its normal at a point of tissue after it.
    pub(super) fn closed_normal(&self, p: &Point, normal: &Vector) -> Vector {
        let Some(Closing { z_gradient: g, .. }) = self.closing(p) else { return *normal };
        let z = normal.z / g.z;
        Vector::new(normal.x - z * g.x, normal.y - z * g.y, z).try_normalize(1e-12).unwrap_or(*normal)
    }

    /// The map back at `p`; `None` where it moves nothing.
    fn closing(&self, p: &Point) -> Option<Closing> {
        let (z, slope) = self.slit.surface_z(p.x);
        let height = p.z - z;
        if height.abs() >= self.reach {
            return None;
        }
        let (a, a_gradient) = self.half_opening(p.x, p.y);
        if a <= 0.0 {
            return None;
        }
        let distance = height.abs();
        let t = self.distance_before(distance, a);
        let sign = if height < 0.0 { -1.0 } else { 1.0 };
        let (w, w_slope) = self.share(t);
        let by_distance = 1.0 / (1.0 + a * w_slope);
        let z_gradient =
            Vector::new(slope * (1.0 - by_distance), 0.0, by_distance) - a_gradient * (sign * w * by_distance);
        Some(Closing { point: Point::new(p.x, p.y, z + sign * t), z_gradient, slope, in_gap: distance <= a })
    }

    /// Place before the opening of a point after it.
    pub(in super::super) fn closed(&self, p: &Point) -> Point {
        self.closed_with_gradient(p).point
    }

    /// Place after the opening of a point before it, on the upper or the lower lip.
    pub(super) fn opened(&self, p: &Point, upper: bool) -> Point {
        let (z, _) = self.slit.surface_z(p.x);
        let distance = (p.z - z).abs();
        let (a, _) = self.half_opening(p.x, p.y);
        if a <= 0.0 || distance >= self.reach {
            return *p;
        }
        let after = distance + a * self.share(distance).0;
        Point::new(p.x, p.y, z + if upper { after } else { -after })
    }
}

#[cfg(test)]
mod tests {
    use super::super::SlitKnot;
    use super::*;

    pub(super) fn slit() -> Slit {
        let knot = |x: f64| SlitKnot {
            front: Point::new(x, -95.0 + 0.01 * x * x, 2.0 - 0.004 * x * x),
            back_y: -84.0 + 0.02 * x * x,
        };
        Slit::new([-24.0, -12.0, 0.0, 12.0, 24.0].map(knot).to_vec()).unwrap()
    }

    fn places() -> impl Iterator<Item = Point> {
        let at = |i: i32, j: i32, k: i32| {
            Point::new(-29.3 + 3.1 * f64::from(i), -99.7 + 4.3 * f64::from(j), -10.9 + 1.7 * f64::from(k))
        };
        (0..19).flat_map(move |i| (0..6).flat_map(move |j| (0..14).map(move |k| at(i, j, k))))
    }

    #[test]
    fn closing_undoes_the_opening_and_moves_nothing_far_away() {
        let slit = slit();
        let opening = Opening::new(&slit, 4.0);
        let mut moved = 0;
        for p in places() {
            let upper = slit.height(&p) >= 0.0;
            let open = opening.opened(&p, upper);
            assert!((opening.closed(&open) - p).norm() < 1e-10, "{p}");
            moved += usize::from((open - p).norm() > 0.5);
            if slit.height(&p).abs() > 10.0 || p.x.abs() > 24.0 {
                assert_eq!(open, p);
            }
        }
        assert!(moved > 150, "{moved}");
    }

    /// A plane that is parallel to the slit's surface before the opening.
    #[test]
    fn normals_close_with_their_surface() {
        let slit = slit();
        let opening = Opening::new(&slit, 4.0);
        for p in [Point::new(3.0, -90.0, 4.5), Point::new(-22.5, -90.0, -2.1), Point::new(23.0, -90.0, 1.0)] {
            let g = opening.closed_with_gradient(&p).z_gradient;
            let (_, slope) = slit.surface_z(p.x);
            let expected = Vector::new(-slope, 0.0, 1.0).normalize();
            let after = Vector::new(g.x - slope, g.y, g.z).normalize();
            assert!((opening.closed_normal(&p, &after) - expected).norm() < 1e-9, "{p}");
        }
    }

    #[test]
    fn gradients_are_those_of_the_values() {
        let slit = slit();
        let opening = Opening::new(&slit, 4.0);
        let h = 1e-6;
        let mut kinks = 0;
        for p in places() {
            let slopes = |f: &dyn Fn(&Point) -> f64| {
                let one = |a: usize, s: f64| s * (f(&(p + Vector::ith(a, s * h))) - f(&p)) / h;
                let (up, down) = ([0, 1, 2].map(|a| one(a, 1.0)), [0, 1, 2].map(|a| one(a, -1.0)));
                // Where the half opening's straight pieces meet, the slopes of both sides differ.
                let kink = (0..3).any(|a| (up[a] - down[a]).abs() > 1e-3);
                (!kink).then(|| Vector::from_fn(|a, _| 0.5 * (up[a] + down[a])))
            };
            let cases = [
                (slopes(&|q| opening.closed(q).z), opening.closed_with_gradient(&p).z_gradient),
                (slopes(&|q| opening.gap(q).0), opening.gap(&p).1),
            ];
            for (found, given) in cases {
                match found {
                    Some(found) => assert!((found - given).norm() < 1e-5, "{p}: {found} but {given}"),
                    None => kinks += 1,
                }
            }
        }
        assert!(kinks < 40, "{kinks}");
    }
}
