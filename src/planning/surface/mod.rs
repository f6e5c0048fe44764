//! Extracts skin and skull surfaces from a CT.
//!
//! Invariants: the surfaces are closed and two-manifold; every removal or repair is reported as a warning.

mod ct;

pub use ct::{CtSettings, CtSurfaces, Levels, from_ct, levels_of};

use prosopon_geometry::control::Cancelled;

/// Reason why no surface could be extracted.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// The volume does not show the structure at the threshold.
    #[error("no {what} found at {threshold_hu} HU: {reason}")]
    NothingFound {
        /// What was searched for: head, skin or bone.
        what: &'static str,
        /// The threshold that was used, HU, also for a volume of other units.
        threshold_hu: f64,
        /// Why it was not found.
        reason: String,
    },
    /// The volume cannot be used.
    #[error("the volume is not usable: {detail}")]
    Volume {
        /// What is wrong, with numbers and units.
        detail: String,
    },
    /// A threshold does not fit the values of the volume.
    #[error("the setting `{name}` is {value}, but the values of the volume are {min} to {max}{found}: {rule}")]
    Level {
        /// Name of the setting in [`CtSettings`].
        name: &'static str,
        /// Its value, in the units of the volume.
        value: f64,
        /// Smallest value of the volume.
        min: f64,
        /// Largest value of the volume.
        max: f64,
        /// Levels of air and soft tissue as the end of a clause; empty when they were not found.
        found: String,
        /// What does not hold.
        rule: &'static str,
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
