//! The published methods that the adaptive field is compared with.
//!
//! Signs come from pseudonormals, as in the papers: right on closed manifold surfaces, wrong in places on dirty ones.
//! Invariants: finite at every finite point; the same bits at any number of threads.

mod block;
mod cell;
mod far;
mod frisken;
mod hybrid;
mod octree;
mod packed;
mod pseudonormal;
mod report;
mod settings;
mod tile;
mod tolerance;
mod uniform;

pub use octree::Octree;
pub use report::SampledReport;
pub use settings::{Resolution, SampledSettings, Tolerance};
pub use uniform::UniformField;
