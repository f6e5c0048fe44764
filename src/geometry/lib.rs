//! Points, meshes, grids, volumes, rigid motions and implicit solids in patient LPS, mm, `f64`.
//!
//! [`control`] carries cancellation, deadline and progress through long computations.
//!
//! Invariants: a [`TriMesh`] has finite coordinates and indices in range. No function here reads a file or depends on what
//! a mesh represents.

pub mod control;
mod crossing;
mod grid;
mod implicit;
mod quality;
mod self_crossing;
mod solid;
mod surface;
mod topology;
mod trimesh;
mod volume;
mod volume_mesh;
mod warning;

pub use grid::ScalarGrid;
pub use implicit::Implicit;
pub use quality::{SurfaceReport, surface_report};
pub use solid::why_no_solid;
pub use surface::{
    Topology, decimate, decimate_with, drop_small_parts, isosurface, largest_part, parts, smooth, submesh,
};
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
