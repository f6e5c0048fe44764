//! Elements, materials, contact and the Newton solver for soft tissue.
//!
//! Invariants: knows meshes and implicit bodies only, no patients, plans or files; the same input gives the same bits
//! at any thread count; every failure has a name and says where; a step that would invert an element is cut, never taken.
//!
//! All elements are treated alike: a *generalised node* carries one 3-vector (a position, or a tangent vector of the C1
//! prism's outer surface), and an [`element::ElementBlock`] holds gradients of its shape functions at quadrature points.

mod assembly;
mod cell_states;
mod checkpoint;
mod compliance;
mod condensed;
mod contact;
mod diagnosis;
mod dofs;
pub mod element;
mod equations;
mod error;
mod factor;
mod line_search;
mod linear_solve;
pub mod material;
mod memory;
mod newton;
mod ordering;
mod quadratic_model;
mod report;
mod saved_state;
mod settings;
mod setup;
mod solver;
mod support;
mod triangular;

pub use checkpoint::{Checkpoint, FactorOrigin, MotionNumbers, motion_numbers, motion_of_numbers};
pub use error::SolveError;
pub use report::{CellState, IterationRecord, LostEllipticity, PhaseTimes, StepOutcome, StepReport, Sunk};
pub use saved_state::SavedState;
pub use settings::{Boundary, ContactBody, Locking, Model, Preset, SkinElement, SolveSettings, UnstableMaterial};
pub use setup::Prepared;
pub use solver::Solver;
pub use support::check_support;

#[cfg(test)]
mod tests;
