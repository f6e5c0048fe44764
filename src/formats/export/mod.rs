//! Writes surfaces (GLB, PLY, STL, VTP), volume meshes (VTU) and volumes (NIfTI) to bytes.
//!
//! Invariants: the output depends only on the input, not on clock or host. It is little-endian. Coordinates are in LPS mm,
//! except that the NIfTI affine is in RAS mm, as its format demands.

mod error;
mod glb;
mod glb_body;
mod nifti;
mod path_glb;
mod ply;
mod stl;
#[cfg(test)]
mod tests;
mod view;
mod vtp;
mod vtu;

pub use error::ExportError;
pub use glb::glb;
pub use nifti::nifti_gz;
pub use path_glb::{PathStep, PathView, path_glb};
pub use ply::ply;
pub use stl::stl;
pub use view::SurfaceView;
pub use vtp::vtp;
pub use vtu::{vtu, vtu_of_mesh};
