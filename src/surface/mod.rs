//! Volumes and scalar grids to surfaces: isosurface, components, smoothing, decimation, skin and skull from CT.
//!
//! Invariants: an isosurface is closed and two-manifold, whatever the values; decimation keeps a closed manifold closed;
//! every change made to a surface is reported.

mod bucket_queue;
mod cell_table;
mod ct;
mod decimate;
mod isosurface;
mod live_mesh;
mod parts;
mod point_triangle;
mod quadric;
mod smooth;
mod topology;

pub use ct::{BONE_LEVELS_HU, CtSettings, CtSurfaces, SKIN_LEVELS_HU, from_ct};
pub use decimate::decimate;
pub use isosurface::isosurface;
pub use parts::{drop_small_parts, largest_part, parts, submesh};
pub use smooth::smooth;
pub use topology::Topology;

use crate::control::Cancelled;

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
