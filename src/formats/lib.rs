//! Bytes to volumes and meshes ([`import`]), and back ([`export`]).

pub mod export;
pub mod import;
