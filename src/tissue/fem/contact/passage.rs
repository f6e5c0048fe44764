//! Points that change the side of a body.

use super::LEAST_PASSAGE_MM;
use prosopon_geometry::{Implicit, Point, Vector};

/// Distances from the middle of a way, in lengths of it, at which a way round a rim is looked for.
const DETOURS: [f64; 3] = [0.25, 0.5, 1.0];
/// Sum of two normals below which they look to no common side.
const LEAST_SUM: f64 = 0.1;

/// A contact point that has come to the other side of a body.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct Passage {
    /// Index of the contact point.
    pub(in crate::fem) point: usize,
    /// Index of the body.
    pub(in crate::fem) body: usize,
    /// Where the point is now.
    pub(in crate::fem) place: Point,
    /// Whether a way that is not much longer leads round the body.
    pub(in crate::fem) round_a_rim: bool,
}

/// Whether the straight way does not lead through the solid.
pub(super) fn is_clear(solid: &dyn Implicit, from: &Point, to: &Point) -> bool {
    let way = to - from;
    let samples = (way.norm() / LEAST_PASSAGE_MM).ceil() as usize;
    (1..=samples).all(|i| solid.value(&(from + way * (i as f64 / samples as f64))) >= -0.25 * LEAST_PASSAGE_MM)
}

/// Whether a way that is not much longer leads round the solid, by a point off the middle of the straight one on the side that both
/// normals, whose sum is `outward`, look to.
pub(super) fn is_round_a_rim(solid: &dyn Implicit, (from, to): (&Point, &Point), outward: &Vector) -> bool {
    let length = (to - from).norm();
    outward.norm() > LEAST_SUM
        && DETOURS.iter().any(|share| {
            let by = from + (to - from) * 0.5 + outward.normalize() * (share * length);
            is_clear(solid, from, &by) && is_clear(solid, &by, to)
        })
}
