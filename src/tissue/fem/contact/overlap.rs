//! Points that lie inside bone at rest.

use super::LEAST_PASSAGE_MM;
use prosopon_geometry::{Implicit, Point, Vector};

/// Steps in which the surface is looked for from a point inside, and the least of one, mm.
const SHIFT_STEPS: usize = 100;
const LEAST_SHIFT_MM: f64 = 0.01;
/// Depths of a point within which the surface counts as the one on its side.
const LONGEST_SHIFT: f64 = 3.0;

/// How a point that lies inside a body at rest is measured from there.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Overlap {
    /// From the point to the body's surface on the tissue's side, mm: the distance is taken there, since deep in thin bone it has no
    /// direction to rely on. Zero where that side is not found.
    pub(super) shift: Vector,
    /// What overlaps there still, mm.
    pub(super) rest_mm: f64,
}

impl Overlap {
    /// Of a point at which `solid` has `value`.
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
