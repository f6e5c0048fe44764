//! Shape functions of tetrahedra, wedges and C1 prisms, evaluated at quadrature points of the rest configuration.
//!
//! A block holds gradients and weights only: later code does not depend on the kind of element. Every block returned here has
//! positive weights.

mod blended_cubic;
mod block;
mod c1_prism;
mod c1_surface;
mod linear;
mod normal_jump;
mod patches;
mod prism_split;
mod quadrature;
mod rest_shape;
#[cfg(test)]
mod sample_meshes;
mod smoothing;

pub use block::{ElementBlock, ElementError, MeshCell};
pub use c1_prism::{c1_prisms, plain_prisms};
pub use c1_surface::{C1Surface, wedges_warning};
pub use linear::{tetrahedra, wedges};
pub use normal_jump::NormalJump;
pub use patches::patches;
pub use prism_split::prisms_as_tetrahedra;
pub use quadrature::TriangleRule;
pub use smoothing::{SMOOTHED_WIDTHS, edge_domains, node_domains};
