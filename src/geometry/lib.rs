//! Points, triangle meshes, grids, volumes, rigid motions and implicit solids; cancel and progress ([`control`]).
//! Patient LPS, mm, `f64`.
//!
//! Invariants: a [`TriMesh`] has finite coordinates and indices in range; nothing here reads files or
//! knows what a mesh stands for.

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

/// A point in patient LPS, mm.
pub type Point = nalgebra::Point3<f64>;
/// A vector in patient LPS, mm unless its name says otherwise.
pub type Vector = nalgebra::Vector3<f64>;
/// A rigid motion `target_from_source`: rotation, then translation in mm.
pub type Motion = nalgebra::Isometry3<f64>;
