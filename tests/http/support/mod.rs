//! Support for the tests: the service in process or as a binary, the stand-in for the numerics, and files to upload.

pub(crate) mod app;
pub(crate) mod binary;
pub(crate) mod boxes;
pub(crate) mod dicom;
pub(crate) mod processes;
pub(crate) mod shapes;
pub(crate) mod stand_in;
pub(crate) mod tissue_mesh;
