//! Points, meshes, grids, volumes, rigid motions and implicit solids in patient LPS, mm, `f64`.
//!
//! [`control`] carries cancellation, deadline and progress through long computations.
//!
//! Invariants: a [`TriMesh`] has finite coordinates and indices in range. No function here reads a file or depends on what
//! a mesh represents.

mod connectivity;
pub mod control;
mod flat;
mod grid;
mod implicit;
mod placed_grid;
mod places;
mod self_intersection;
mod solid;
mod surface;
mod surface_report;
mod triangle_intersection;
mod trimesh;
mod volume;
mod volume_mesh;
mod warning;

pub use flat::Flat;
pub use grid::ScalarGrid;
pub use implicit::Implicit;
pub use placed_grid::PlacedGrid;
pub use places::moved_places;
pub use solid::not_solid_reason;
pub use surface::{
    Mending, TopologyFaults, Welder, decimate, decimate_with, drop_small_parts, isosurface, largest_part, mend, parts,
    smooth, submesh,
};
pub use surface_report::{SurfaceReport, surface_report};
pub use trimesh::{Aabb, GeometryError, TriMesh};
pub use volume::Volume;
pub use volume_mesh::{Cell, DataArray, VolumeMesh};
pub use warning::{Severity, Warning};

/// A point in patient LPS, mm.
pub type Point = nalgebra::Point3<f64>;
/// A vector in patient LPS, mm unless its name says otherwise.
pub type Vector = nalgebra::Vector3<f64>;
/// A rigid motion `target_from_source`: rotation, then translation in mm.
pub type Motion = nalgebra::Isometry3<f64>;
