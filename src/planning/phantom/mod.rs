//! An analytic head: skin, skull with separable maxilla and mandible, airway.
//! It serves as ground truth in tests and as the patient of the demo when none is given.
//!
//! Invariants: pure functions of the settings; no patient data; left and right are mirror images about x = 0.
//!
//! # Frame
//! LPS mm with the face towards -y.
//! The occlusal plane is z = 0, and the condyles lie near y = 8. The proportions are those of an average adult from textbook
//! distances, not of a particular person.

mod air;
mod arches;
mod ct;
#[cfg(test)]
mod ct_tests;
#[cfg(test)]
mod ct_units_tests;
mod dual;
mod head;
mod landmarks;
mod mouth;
mod sampling;
mod shapes;
mod skin;
mod skull;
#[cfg(test)]
mod tests;

pub use head::{Phantom, head, head_with_mouth};
pub use landmarks::Landmarks;
pub use mouth::PhantomMouth;
pub use sampling::surface_of;
