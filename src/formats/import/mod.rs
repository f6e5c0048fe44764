//! Bytes to volumes and surfaces. Everything that arrives here is untrusted.
//!
//! Invariants: takes `&[u8]`, never a path; every size, index and count is checked before it is used or
//! allocated; no panic on any input; patient tags are never read; no error or warning repeats content of the file.
//!
//! One file a format. A reader of a surface turns bytes into a private list of vertices and triangles, and `surface`
//! does what all formats share: ranges, triangles without area by index, unused vertices, plausible size.
//!
//! Only NIfTI headers, gzip, zip, and the pixels of JPEG, JPEG-LS and JPEG 2000 are read by crates. `stl_io` takes binary files whose comment begins with "solid" for
//! text; `ply-rs-bw` lets the last of two elements of one name win and then reads the payload askew, loops over
//! elements without properties as often as the header says, and quotes the file in its errors; `tobj` overflows on
//! crafted indices, keeps `f32` only, and splits a surface at its groups so that shared vertices part.

#![cfg_attr(not(test), warn(clippy::indexing_slicing, clippy::arithmetic_side_effects))]

mod archive;
mod dicom;
mod error;
#[cfg(test)]
mod hostile;
mod hounsfield;
mod lattice;
mod meta_image;
mod nifti1;
mod nrrd;
mod number;
mod obj;
mod ply;
mod polygon;
mod stl;
mod surface;
#[cfg(test)]
mod test_fuzz;
mod text;
#[cfg(test)]
mod text_volumes_tests;
mod volume;
mod volume_scan;
mod vtu;

pub use error::{ImportError, Limits};
pub use surface::{SurfaceFormat, detect_surface, surface};
pub use volume::{SeriesChoice, VolumeFormat, VolumeRead, VolumeSettings, detect_volume, volume, volume_with};
pub use volume_scan::VolumeScan;
pub use vtu::{is_legacy_vtk, volume_mesh};
