//! The mixed mesh: one layer of prisms under the skin, tetrahedra inside, conforming.
//!
//! Invariants: every element has positive volume; each prism's inner triangle is a face of a tetrahedron or lies on the bone;
//! the attachment of a node states its boundary condition.
//!
//! [`build`] works in these steps:
//! 1. Find walls between two sheets of skin (`refinement_marks`).
//! 2. Fill the inner tissue with tetrahedra (`stuffing`, `lattice`, `refined_lattice`, `stencil`).
//! 3. Press it onto bone where it is thin (`press`) and leave out pockets that do not reach the skin (`pockets`).
//! 4. Improve the tetrahedra (`smooth`) and extrude the skin side to the skin (`prisms`).
//! 5. Bring the outer faces of the prisms close to the skin (`fit_outer_nodes`, `refine`) and drop small parts (`parts`).
//! 6. Label nodes, faces and tissue (`classify`), measure the mesh (`report`) and warn of what it lacks (`left_out`).
//!
//! With lips that part ([`build_parted`]) all of this is done on tissue that is opened along the slit, and the mesh is closed
//! again (`slit`).
//!
//! All tuning numbers stand in `tuning`.

mod adjacency;
mod boundary;
mod build;
mod classify;
mod domain;
mod embedding;
mod error;
mod fit_outer_nodes;
#[cfg(test)]
mod invariants_tests;
mod lattice;
mod left_out;
mod mixed_mesh;
mod parts;
mod pockets;
mod press;
mod prisms;
mod quality;
mod refine;
mod refined_lattice;
mod refinement_marks;
mod repair;
mod report;
mod slit;
mod smooth;
mod stencil;
mod stuffing;
#[cfg(test)]
mod test_cases;
#[cfg(test)]
mod test_domain;
#[cfg(test)]
mod test_invariants;
#[cfg(test)]
mod tests;
mod trial;
mod tuning;
mod volume;

pub use boundary::{boundary_of, boundary_triangles};
pub use build::{build, build_parted};
pub use classify::tie;
pub use domain::{Domain, MeshSettings, Region};
pub use embedding::{Embedding, embed};
pub use error::MeshError;
pub use mixed_mesh::{Attachment, Facing, MixedMesh, Tissue};
pub use report::{MeshReport, report};
pub use slit::{PartedSkin, Slit, SlitError, SlitKnot, embed_parted, part_skin};
