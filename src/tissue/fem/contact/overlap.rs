//! Contact points that lie inside bone at rest.

use super::LEAST_PASSAGE_MM;
use prosopon_geometry::{Implicit, Point, Vector};

/// Largest number of steps in the search for the surface from a point inside, and the shortest step, mm.
const SHIFT_STEPS: usize = 100;
const LEAST_SHIFT_MM: f64 = 0.01;
/// The surface counts as the one on the tissue's side up to this many depths of the point.
const LONGEST_SHIFT: f64 = 3.0;

/// Reference from which the gap of a point that overlaps a body at rest is measured.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Overlap {
    /// From the point to the body's surface on the tissue's side, mm. The distance is evaluated there, because deep in thin bone
    /// its gradient is unreliable. Zero where that side is not found.
    pub(super) shift: Vector,
    /// Overlap that remains after the shift, mm.
    pub(super) rest_mm: f64,
}

impl Overlap {
    /// Overlap of a point `at` where `solid` has `value`; `inward` points into the tissue.
    pub(super) fn of(solid: &dyn Implicit, at: &Point, value: f64, inward: &Vector) -> Self {
        if value >= 0.0 {
            return Self::default();
        }
        let outside = inward.try_normalize(0.0).and_then(|n| {
            let (mut way, mut depth) = (0.0, -value);
            for _ in 0..SHIFT_STEPS {
                way += depth.max(LEAST_SHIFT_MM);
                depth = -solid.value(&(at + n * way));
                if depth <= 0.0 {
                    return Some(n * way);
                }
                if way > LONGEST_SHIFT * -value + LEAST_PASSAGE_MM {
                    break;
                }
            }
            None
        });
        match outside {
            Some(shift) => Self { shift, rest_mm: 0.0 },
            None => Self { shift: Vector::zeros(), rest_mm: -value },
        }
    }
}
