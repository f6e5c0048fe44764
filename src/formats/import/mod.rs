//! Reads volumes, surfaces and volume meshes from untrusted bytes.
//!
//! Invariants: readers take `&[u8]`, never a path. Every size, index and count is checked before it is used or allocated.
//! No input causes a panic. Patient tags are never read. No error or warning repeats text of the file;
//! they may state counts, sizes and positions.
//!
//! Each format has one module. A surface reader turns bytes into unchecked vertices and triangles; `raw_surface` then does
//! what all formats share: it checks ranges and the plausible size, converts what the file states of its coordinates to LPS and
//! mm, makes equal positions one vertex, drops unused vertices and triangles that repeat a vertex or another triangle, and turns
//! triangles outwards.
//!
//! # Adding a surface format
//! 1. Write a module with `looks_like` and `read`, which returns a `RawSurface`.
//! 2. Add a variant to [`SurfaceFormat`], and an arm to [`surface()`].
//! 3. Give it a place in [`detect_surface`], with the reason there.
//! 4. In `malformed_tests.rs` add it to `FORMATS` and a file of it to `surfaces()`.
//! 5. Add its media types to `named_format` in `src/service/http/routes/inputs.rs`, and its name to the texts that list formats
//!    (search for `VTP`).
//!
//! # Crates
//! Crates read only NIfTI headers, gzip, zip, XML, and the pixels of JPEG, JPEG-LS and JPEG 2000. The crates for surfaces
//! have these faults:
//! - `stl_io` reads binary files whose comment begins with "solid" as text.
//! - `ply-rs-bw` keeps the last of two elements with one name and then misreads the payload, loops over elements without
//!   properties as often as the header states, and quotes the file in its errors.
//! - `tobj` overflows on crafted indices, keeps only `f32`, and splits a surface at its groups, which separates shared vertices.

#![cfg_attr(not(test), warn(clippy::indexing_slicing, clippy::arithmetic_side_effects))]

mod archive;
mod detached;
mod dicom;
mod error;
mod hounsfield;
mod landmark_file;
mod lattice;
#[cfg(test)]
mod malformed_tests;
mod meta_image;
mod nifti1;
mod nrrd;
mod number;
mod obj;
mod ply;
mod polygon;
mod raw_surface;
mod stated;
mod stl;
mod surface;
#[cfg(test)]
mod test_fuzz;
mod text;
#[cfg(test)]
mod text_volumes_tests;
mod transform_file;
mod volume;
mod volume_archive;
mod volume_check;
mod volume_detect;
mod volume_settings;
mod vtu;

pub use error::{ImportError, Limits};
pub use landmark_file::{
    LandmarkFile, LandmarkFrame, LandmarkName, fiducials, landmark_name, legal_name, looks_like_fiducials,
};
pub(crate) use stated::LPS_MARKER;
pub use surface::{SurfaceFormat, detect_surface, surface};
pub use transform_file::{
    Affine, ItkTransform, NotRigid, RIGID_WITHIN, RigidMotion, TransformFormat, detect_transform, itk_affine,
    rigid_motion, rigid_of_matrix, transform,
};
pub use volume::{volume, volume_with};
pub use volume_check::VolumeCheck;
pub use volume_detect::detect_volume;
pub use volume_settings::{SeriesChoice, VolumeFormat, VolumeRead, VolumeSettings};
pub use vtu::{is_legacy_vtk, volume_mesh};
