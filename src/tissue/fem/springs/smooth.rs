//! A solid's distance averaged over a small ball.

use prosopon_geometry::{Implicit, Point, Vector};

/// Distance from `solid` averaged over points at `radius_mm` around the place: bumps smaller than that are levelled.
pub(super) struct Smooth<'a> {
    pub(super) solid: &'a dyn Implicit,
    pub(super) radius_mm: f64,
}

/// The eight corners of a cube on the unit sphere and, with a lower weight, the six points on its axes: they integrate
/// polynomials of degree 5 over a sphere exactly.
const CORNER_WEIGHT: f64 = 3.0 / 40.0;
const AXIS_WEIGHT: f64 = 1.0 / 15.0;

impl Smooth<'_> {
    fn points(&self, p: &Point) -> impl Iterator<Item = (Point, f64)> {
        let (at, radius) = (*p, self.radius_mm);
        let side = radius / 3.0f64.sqrt();
        let sign = move |corner: usize, axis: usize| if corner >> axis & 1 == 1 { side } else { -side };
        let corners = (0..8).map(move |i| (at + Vector::new(sign(i, 0), sign(i, 1), sign(i, 2)), CORNER_WEIGHT));
        let ends = move |i: usize| Vector::ith(i / 2, if i.is_multiple_of(2) { radius } else { -radius });
        corners.chain((0..6).map(move |i| (at + ends(i), AXIS_WEIGHT)))
    }
}

impl Implicit for Smooth<'_> {
    fn value(&self, p: &Point) -> f64 {
        self.points(p).map(|(q, weight)| weight * self.solid.value(&q)).sum()
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        self.points(p).fold((0.0, Vector::zeros()), |(value, gradient), (q, weight)| {
            let (v, g) = self.solid.value_gradient(&q);
            (value + weight * v, gradient + g * weight)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A polynomial of degree 4.
    struct Quartic;

    impl Implicit for Quartic {
        fn value(&self, p: &Point) -> f64 {
            p.x.powi(4) + 2.0 * p.x * p.y.powi(2) - p.z + 1.0
        }
        fn value_gradient(&self, p: &Point) -> (f64, Vector) {
            let gradient = Vector::new(4.0 * p.x.powi(3) + 2.0 * p.y.powi(2), 4.0 * p.x * p.y, -1.0);
            (self.value(p), gradient)
        }
    }

    #[test]
    fn the_mean_over_a_sphere_is_that_of_the_integral() {
        let smooth = Smooth { solid: &Quartic, radius_mm: 2.0 };
        // Means over a sphere of radius r: x² has r²/3, x⁴ has r⁴/5.
        let (value, gradient) = smooth.value_gradient(&Point::origin());
        assert!((value - (16.0 / 5.0 + 1.0)).abs() < 1e-12 && (smooth.value(&Point::origin()) - value).abs() < 1e-12);
        assert!((gradient - Vector::new(8.0 / 3.0, 0.0, -1.0)).norm() < 1e-12, "{gradient}");
    }
}
