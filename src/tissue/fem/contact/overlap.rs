//! Contact points that lie inside bone at rest.

use crate::fem::tuning::{OVERLAP_SEARCH_DEPTHS, OVERLAP_STEP_MM, OVERLAP_STEPS, PASSAGE_SAMPLE_MM};
use prosopon_geometry::{Implicit, Point, Vector};

/// Reference from which the gap of a point that overlaps a body at rest is measured.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::fem) struct Overlap {
    /// From the point to the body's surface on the tissue's side, mm. The distance is evaluated there, because deep in thin bone
    /// its gradient is unreliable. Zero where that side is not found.
    pub(in crate::fem) shift: Vector,
    /// Overlap that remains after the shift, mm.
    pub(in crate::fem) rest_mm: f64,
}

impl Overlap {
    /// Overlap of a point `at` where `solid` has `value`; `inward` points into the tissue.
    pub(in crate::fem) fn of(solid: &dyn Implicit, at: &Point, value: f64, inward: &Vector) -> Self {
        if value >= 0.0 {
            return Self::default();
        }
        let outside = inward.try_normalize(0.0).and_then(|n| {
            let (mut distance, mut depth) = (0.0, -value);
            for _ in 0..OVERLAP_STEPS {
                distance += depth.max(OVERLAP_STEP_MM);
                depth = -solid.value(&(at + n * distance));
                if depth <= 0.0 {
                    return Some(n * distance);
                }
                if distance > OVERLAP_SEARCH_DEPTHS * -value + PASSAGE_SAMPLE_MM {
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
