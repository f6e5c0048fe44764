use super::super::tuning::LIP_FILLET_MM;
use super::Opening;
use prosopon_geometry::{Implicit, Point, Vector};

/// A solid in the opened tissue.
pub(in super::super) struct Opened<'a> {
    pub(in super::super) solid: &'a dyn Implicit,
    pub(in super::super) opening: &'a Opening<'a>,
}

impl Implicit for Opened<'_> {
    fn value(&self, p: &Point) -> f64 {
        self.solid.value(&self.opening.closed(p))
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let closed = self.opening.closed_with_gradient(p);
        let (value, g) = self.solid.value_gradient(&closed.point);
        (value, Vector::new(g.x, g.y, 0.0) + closed.z_gradient * g.z)
    }
}

/// The skin of the opened tissue: the gap lies outside it, and the edges of the lips are rounded.
pub(in super::super) struct OpenedSkin<'a>(pub(in super::super) Opened<'a>);

impl OpenedSkin<'_> {
    /// Value of the skin without the gap, mm.
    pub(in super::super) fn outer_value(&self, p: &Point) -> f64 {
        self.0.value(p)
    }
}

impl std::fmt::Debug for OpenedSkin<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OpenedSkin").field("opening", self.0.opening).finish_non_exhaustive()
    }
}

impl Implicit for OpenedSkin<'_> {
    fn value(&self, p: &Point) -> f64 {
        rounded_maximum(self.0.value(p), self.0.opening.gap(p).0).0
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (skin, skin_gradient) = self.0.value_gradient(p);
        let (gap, gap_gradient) = self.0.opening.gap(p);
        let (value, share) = rounded_maximum(skin, gap);
        (value, skin_gradient * (1.0 - share) + gap_gradient * share)
    }
}

/// Maximum of two values with a fillet, and its derivative by the second one; that by the first one is the rest to 1.
fn rounded_maximum(a: f64, b: f64) -> (f64, f64) {
    let h = (1.0 - (a - b).abs() / LIP_FILLET_MM).max(0.0);
    let less = 0.5 * h;
    (a.max(b) + 0.25 * LIP_FILLET_MM * h * h, if b > a { 1.0 - less } else { less })
}

#[cfg(test)]
mod tests {
    use super::super::super::test_domain::Shape;
    use super::super::{Slit, SlitKnot};
    use super::*;

    #[test]
    fn gradients_of_opened_solids_are_those_of_their_values() {
        let knot = |x: f64| SlitKnot { front: Point::new(x, -30.0, 1.0), back_y: -18.0 };
        let slit = Slit::new([-15.0, 0.0, 15.0].map(knot).to_vec()).unwrap();
        let opening = Opening::new(&slit, 4.0);
        let ball = Shape::ball(Point::origin(), 30.0);
        let skin = OpenedSkin(Opened { solid: &ball, opening: &opening });
        let h = 1e-4;
        let (mut checked, mut off) = (0, 0);
        for i in 0..4000u32 {
            let unit = |k: u32| f64::from((i * 3 + k).wrapping_mul(2_654_435_761)) / f64::from(u32::MAX);
            let p = Point::new(40.0 * unit(0) - 20.0, 20.0 * unit(1) - 35.0, 24.0 * unit(2) - 12.0);
            let (value, gradient) = skin.value_gradient(&p);
            assert_eq!(value, skin.value(&p));
            let central = Vector::from_fn(|a, _| {
                (skin.value(&(p + Vector::ith(a, h))) - skin.value(&(p - Vector::ith(a, h)))) / (2.0 * h)
            });
            checked += 1;
            off += usize::from((central - gradient).norm() > 1e-3);
        }
        // Only across a kink of the opening do differences over 0.2 µm see two slopes.
        assert!(off * 200 < checked, "{off} of {checked}");
    }
}
