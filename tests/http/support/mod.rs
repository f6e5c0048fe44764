//! Support for the tests: the service in process or as a binary, the stand-in for the numerics, and surfaces to upload.

pub(crate) mod app;
pub(crate) mod binary;
pub(crate) mod shapes;
pub(crate) mod stand_in;
