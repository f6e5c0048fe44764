//! Isosurfaces of scalar grids, connected parts, smoothing, decimation, and mending.
//!
//! Invariants: an isosurface is a closed two-manifold for any values; decimation keeps a closed manifold closed.

mod blocks;
mod bucket_queue;
mod cell_table;
mod decimate;
mod isosurface;
mod live_mesh;
mod mend;
mod orient;
mod parts;
mod point_triangle;
mod quadric;
mod rims;
mod smooth;
mod topology;
mod twins;
mod weld;

pub use decimate::{decimate, decimate_with};
pub use isosurface::isosurface;
pub use mend::{Mending, mend};
pub use parts::{drop_small_parts, largest_part, parts, submesh};
pub use smooth::smooth;
pub use topology::TopologyFaults;
pub use weld::Welder;
