//! The line along which the closed lips of the phantom meet.

use prosopon_geometry::Point;

/// Distance of the commissures from the midline, mm.
pub(super) const MOUTH_HALF_WIDTH_MM: f64 = 23.0;
/// Height of stomion, mm.
pub(super) const MOUTH_Z_MM: f64 = 1.6;
/// The commissures lie lower by this times the square of their distance from the midline, 1/mm.
pub(super) const MOUTH_BEND_PER_MM: f64 = 0.003;

/// The slit between the closed lips: the surface `z = z_at(x)` for x within the half width, from the skin back to the vestibule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhantomMouth {
    /// Distance of the commissures from the midline, mm.
    pub half_width_mm: f64,
}

impl PhantomMouth {
    pub(super) fn new() -> Self {
        Self { half_width_mm: MOUTH_HALF_WIDTH_MM }
    }

    /// Height of the slit at `x`, mm.
    #[must_use]
    pub fn z_at(&self, x: f64) -> f64 {
        MOUTH_Z_MM - MOUTH_BEND_PER_MM * x * x
    }

    /// First point from in front at `x` at which `skin` is reached; `None` where there is none.
    #[must_use]
    pub fn on_skin(&self, skin: &dyn prosopon_geometry::Implicit, x: f64) -> Option<Point> {
        let places = (0..2000).map(|i| Point::new(x, -130.0 + 0.05 * f64::from(i), self.z_at(x)));
        places.into_iter().find(|p| skin.value(p) < 0.0)
    }
}
