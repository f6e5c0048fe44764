//! Elements, materials, contact and the Newton solver for soft tissue.
//!
//! Invariants: the module knows meshes and implicit bodies, but no patients, plans or files. The same input gives the same
//! bits at any number of threads. Every failure has a name and a position. A step that would invert an element is shortened,
//! never taken.
//!
//! All elements are treated alike: a *generalised node* carries one 3-vector (a position, or a tangent vector of the C1
//! prism's outer surface), and an [`element::ElementBlock`] holds gradients of its shape functions at quadrature points.
//!
//! # Example
//!
//! A cube of neo-Hookean tissue with edges of 1 mm, stretched by 10 % along z, with free sides:
//!
//! ```
//! use prosopon_geometry::control::Control;
//! use prosopon_geometry::{Point, Vector};
//! use prosopon_tissue::fem::material::{Material, Materials};
//! use prosopon_tissue::fem::{Boundary, Model, SolveSettings, Solver};
//! use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue};
//!
//! // Node x + 2 y + 4 z; six tetrahedra share the diagonal from node 0 to node 7.
//! let position = |i: u8| Point::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1));
//! let mesh = MixedMesh {
//!     positions: (0..8).map(position).collect(),
//!     tetrahedra: vec![[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]],
//!     tetrahedron_tissue: vec![Tissue::Fat; 6],
//!     prisms: Vec::new(),
//!     prism_tissue: Vec::new(),
//!     bone_faces: Vec::new(),
//!     attachment: vec![Attachment::Free; 8],
//!     depth_cut_nodes: Vec::new(),
//!     facing: Vec::new(),
//! };
//! // The faces x = 0 and y = 0 are planes of symmetry; all nodes are held along z, and those at z = 1 move by 0.1 mm.
//! let held_axes = (0..8u8).map(|i| u8::from(i & 1 == 0) + 2 * u8::from(i & 2 == 0) + 4).collect();
//! let prescribed_mm = (0..8u8).map(|i| Vector::new(0.0, 0.0, if i < 4 { 0.0 } else { 0.1 })).collect();
//! let boundary = Boundary { held_axes, prescribed_mm, ..Boundary::default() };
//! let materials = Materials::homogeneous(Material::neo_hookean(0.02, 0.45));
//! let settings = SolveSettings::new(Model::Nonlinear, materials);
//! let control = Control::new();
//!
//! let mut solver = Solver::with_boundary(&mesh, Vec::new(), &boundary, settings, &control)?;
//! let report = solver.advance(1.0, &|_| Vec::new(), &control)?;
//! assert!(report.outcome.converged());
//! let corner = solver.positions()[7];
//! assert!((corner.z - 1.1).abs() < 1e-12);
//! // Both sides contract alike, and the volume hardly changes.
//! assert!(corner.x > 0.95 && corner.x < 0.965 && (corner.x - corner.y).abs() < 1e-4);
//! assert!(report.min_det_f > 1.0 && report.min_det_f < 1.02);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assembly;
mod axes;
mod cell_states;
mod checkpoint;
mod checks;
mod compliance;
mod condensed;
mod contact;
mod coupling;
mod diagnosis;
mod dofs;
mod dot;
pub mod element;
mod equations;
mod error;
mod factor;
mod factor_origin;
mod failure;
mod flags;
mod line_search;
mod linear_solve;
pub mod material;
mod memory;
mod newton;
mod node_core;
mod ordering;
mod precision;
mod problem;
mod quadratic_model;
mod report;
mod settings;
mod setup;
mod solver;
mod springs;
mod start_state;
mod state;
mod step_report;
mod substep;
mod support;
mod triangular;
mod tuning;
mod workspace;

pub use checkpoint::{Checkpoint, MotionNumbers, motion_numbers, motion_of_numbers};
pub use error::SolveError;
pub use factor_origin::FactorOrigin;
pub use report::{BonePenetration, CellState, IterationRecord, LostEllipticity, PhaseTimes, StepOutcome, StepReport};
pub use settings::{Boundary, ContactBody, Locking, Model, Preset, SkinElement, SolveSettings, UnstableMaterial};
pub use setup::Prepared;
pub use solver::Solver;
pub use start_state::StartState;
pub use support::check_support;

#[cfg(test)]
mod tests;
