//! Skin and skull from a CT.
//!
//! Invariants: the surfaces are closed and two-manifold; every change made to a surface is reported.

mod ct;

pub use ct::{BONE_LEVELS_HU, CtSettings, CtSurfaces, SKIN_LEVELS_HU, from_ct};

use prosopon_geometry::control::Cancelled;

/// Why no surface came out.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    /// Nothing crosses the threshold.
    #[error("no {what} found: nothing in the volume crosses {threshold} {unit}")]
    NothingFound {
        /// Skin, bone, …
        what: &'static str,
        /// The level that was looked for.
        threshold: f64,
        /// Unit of the level.
        unit: &'static str,
    },
    /// The volume cannot be used.
    #[error("the volume is not usable: {detail}")]
    Volume {
        /// What is wrong with it.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
