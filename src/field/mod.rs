//! Signed distance fields of surfaces, smooth enough for contact.
//!
//! Invariants: value, gradient and Hessian belong to one C1 function; finite at every finite point, also far
//! outside the band; negative inside. Built from any triangle soup, dirty or open.

mod banded;
mod bricks;
mod build;
mod check;
mod closing;
mod coarse;
mod crossings;
mod defects;
mod distance_field;
mod envelope;
mod error;
mod exact;
mod features;
mod fit;
mod flood;
mod lattice;
mod refine;
mod rim;
mod scan;
mod sky;
mod spline;
mod tiles;
mod tree;
mod triangle;
mod winding;

pub use build::{FieldReport, FieldSettings};
pub use distance_field::DistanceField;
pub use envelope::{Envelope, EnvelopeSettings, envelope};
pub use error::FieldError;
pub use exact::ExactDistance;

#[cfg(test)]
mod tests;
