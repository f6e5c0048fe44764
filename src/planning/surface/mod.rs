//! Extracts skin and skull surfaces from a CT.
//!
//! Invariants: the surfaces are closed and two-manifold; every removal or repair is reported as a warning.

mod ct;

pub use ct::{BONE_LEVELS_HU, CtSettings, CtSurfaces, SKIN_LEVELS_HU, from_ct};

use prosopon_geometry::control::Cancelled;

/// Reason why no surface could be extracted.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// No surface was found at the threshold.
    #[error("no {what} found: nothing in the volume crosses {threshold} {unit}")]
    NothingFound {
        /// What was searched for, for example skin or bone.
        what: &'static str,
        /// The threshold that was used.
        threshold: f64,
        /// Unit of the threshold.
        unit: &'static str,
    },
    /// The volume or a setting cannot be used.
    #[error("the volume is not usable: {detail}")]
    Volume {
        /// What is wrong, with numbers and units.
        detail: String,
    },
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
