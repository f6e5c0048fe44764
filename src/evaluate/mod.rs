//! Comparing and showing surfaces: registration, signed error maps, statistics, pictures.
//!
//! Invariants: a signed error is negative where the prediction lies behind (inside) the reference; a displacement is never called an error.

mod colour;
mod distance;
mod error_map;
mod font;
mod picture;
mod raster;
mod regions;
mod register;
mod statistics;

pub use colour::diverging;
pub use error_map::{ErrorMap, error_map};
pub use picture::{Layer, View, picture};
pub use regions::{FaceRegion, face_regions};
pub use register::register;
pub use statistics::{Statistics, statistics};

use crate::control::Cancelled;

/// Why two surfaces could not be compared.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// Registration did not settle.
    #[error("registration did not settle: {detail}")]
    Registration {
        /// What was reached.
        detail: String,
    },
    /// Inputs do not fit together.
    #[error("{detail}")]
    Input {
        /// What does not fit.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

#[cfg(test)]
mod tests;
