//! The mixed mesh: one layer of prisms under the skin, tetrahedra inside, conforming.
//!
//! Invariants: every element has positive volume; each prism's inner triangle is a face of a tetrahedron (or lies on
//! the bone); node classes say what each inner node does.
//!
//! Way of [`build`]: find walls between two sheets of skin (`grading`), stuff the inner tissue (`stuffing`, `lattice`, `graded`, `stencil`), press it onto bone where it is thin
//! (`thin`), leave out what the skin cannot feel (`pockets`), improve the tetrahedra (`smooth`), move the skin side out
//! to the skin (`prisms`), bring the tops close to it (`settle`, `refine`), drop crumbs (`parts`), label (`classify`) and
//! measure (`report`).

mod adjacency;
mod boundary;
mod build;
mod classify;
mod domain;
mod embedding;
mod error;
mod graded;
mod grading;
mod lattice;
mod mixed_mesh;
mod parts;
mod pockets;
mod prisms;
mod quality;
mod refine;
mod report;
mod settle;
mod smooth;
mod stencil;
mod stuffing;
#[cfg(test)]
mod test_domain;
#[cfg(test)]
mod tests;
mod thin;
mod volume;

pub use boundary::{boundary_of, boundary_triangles};
pub use build::build;
pub use classify::tie;
pub use domain::{Domain, MeshSettings, Region};
pub use embedding::{Embedding, embed};
pub use error::MeshError;
pub use mixed_mesh::{Attachment, MixedMesh, Tissue};
pub use report::{MeshReport, report};
