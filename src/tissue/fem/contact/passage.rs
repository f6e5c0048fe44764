//! Contact points that pass to the other side of a body.

use crate::fem::tuning::{DETOURS, LEAST_NORMAL_SUM, PASSAGE_DEPTH_SHARE, PASSAGE_SAMPLE_MM};
use prosopon_geometry::{Implicit, Point, Vector};

/// A contact point that has passed to the other side of a body.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct Passage {
    /// Index of the contact point.
    pub(in crate::fem) point: usize,
    /// Index of the body.
    pub(in crate::fem) body: usize,
    /// Current position of the point, mm.
    pub(in crate::fem) place: Point,
    /// Whether a path that is not much longer leads round the body.
    pub(in crate::fem) round_a_rim: bool,
}

/// Whether the straight path does not cross the solid.
pub(super) fn is_clear(solid: &dyn Implicit, from: &Point, to: &Point) -> bool {
    let way = to - from;
    let samples = (way.norm() / PASSAGE_SAMPLE_MM).ceil() as usize;
    (1..=samples)
        .all(|i| solid.value(&(from + way * (i as f64 / samples as f64))) >= -PASSAGE_DEPTH_SHARE * PASSAGE_SAMPLE_MM)
}

/// Whether a path that is not much longer leads round the solid. It passes a point beside the middle of the straight path, on the
/// outward side of both normals (`outward` is their sum).
pub(super) fn is_round_a_rim(solid: &dyn Implicit, (from, to): (&Point, &Point), outward: &Vector) -> bool {
    let length = (to - from).norm();
    outward.norm() > LEAST_NORMAL_SUM
        && DETOURS.iter().any(|share| {
            let by = from + (to - from) * 0.5 + outward.normalize() * (share * length);
            is_clear(solid, from, &by) && is_clear(solid, &by, to)
        })
}
