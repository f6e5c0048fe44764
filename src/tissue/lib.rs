//! Soft tissue: the mixed mesh ([`mesh`]) and its finite elements ([`fem`]).

pub mod fem;
pub mod mesh;
