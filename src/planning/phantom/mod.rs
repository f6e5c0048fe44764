//! An analytic head: skin, skull with separable maxilla and mandible, airway. The source of truth in tests and
//! the demo's patient when none is given.
//!
//! Invariants: pure functions of the settings; no patient data; left and right are mirror images about x = 0.
//!
//! # Frame
//! LPS mm with the face towards -y; z = 0 is the occlusal plane, the condyles lie near y = 8. Proportions are those of
//! an average adult, drawn from textbook distances, of no person.

mod air;
mod ct;
#[cfg(test)]
mod ct_tests;
mod dual;
mod head;
mod landmarks;
mod sampling;
mod shapes;
mod skin;
mod skull;
#[cfg(test)]
mod tests;

pub use head::{Phantom, head};
pub use landmarks::Landmarks;
pub use sampling::surface_of;
