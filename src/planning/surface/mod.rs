//! Extracts skin and skull surfaces from a CT.
//!
//! Invariants: the surfaces are closed and two-manifold; every removal or repair is reported as a warning.

mod ct;

pub use ct::{BONE_LEVELS_HU, CtSettings, CtSurfaces, SKIN_LEVELS_HU, from_ct};

use prosopon_geometry::control::Cancelled;

/// Reason why no surface could be extracted.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// The volume does not show the structure at the threshold.
    #[error("no {what} found at {threshold_hu} HU: {reason}")]
    NothingFound {
        /// What was searched for: head, skin or bone.
        what: &'static str,
        /// The threshold that was used, HU.
        threshold_hu: f64,
        /// Why it was not found.
        reason: &'static str,
    },
    /// The volume cannot be used.
    #[error("the volume is not usable: {detail}")]
    Volume {
        /// What is wrong, with numbers and units.
        detail: String,
    },
    /// A setting is not allowed.
    #[error("the setting `{name}` is {value}, allowed is {min} to {max}")]
    Setting {
        /// Name of the setting in [`CtSettings`].
        name: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value allowed.
        min: f64,
        /// Largest value allowed.
        max: f64,
    },
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
