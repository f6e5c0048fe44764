//! Surfaces, volume meshes and volumes to bytes: GLB, PLY, STL, VTP, VTU, NIfTI.
//!
//! Invariants: output is a function of the input only (no clock, no host), little-endian, LPS mm.

mod glb;
mod nifti;
mod ply;
mod stl;
#[cfg(test)]
mod tests;
mod view;
mod vtp;
mod vtu;

pub use glb::glb;
pub use nifti::nifti_gz;
pub use ply::ply;
pub use stl::stl;
pub use view::SurfaceView;
pub use vtp::vtp;
pub use vtu::{vtu, vtu_of_mesh};
