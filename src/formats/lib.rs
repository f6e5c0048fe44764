//! File formats of volumes and meshes: readers ([`import`]) and writers ([`export`]).

pub mod export;
pub mod import;
