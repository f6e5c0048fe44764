//! Published methods for comparison with the adaptive field.
//!
//! Signs come from pseudonormals, as in the papers: right on closed manifold surfaces, wrong in parts on defective ones.
//! Invariants: values are finite at every finite point, and have the same bits at any number of threads.

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
