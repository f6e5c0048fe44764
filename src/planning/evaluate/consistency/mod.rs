//! Checks that the inputs of one head belong together: skin, bone, a second skin and landmarks in one frame and unit.
//!
//! Each check first judges the inputs as they are given. Only where they do not fit is a cause looked for: the change of frame,
//! side or unit that would make them fit. A head in any pose that its surfaces share gives no finding.

mod cause;
mod change;
mod known;
mod landmarks;
mod nesting;
mod order;
mod places;
mod pose;
mod samples;
mod skins;
#[cfg(test)]
mod tests;
mod tuning;

pub use landmarks::{GivenLandmarks, check_landmarks};
pub use nesting::check_skin_and_bone;
pub use skins::check_two_skins;

pub(super) use known::{Tissue, known};
pub(super) use pose::Pose;
pub(super) use samples::spread;
