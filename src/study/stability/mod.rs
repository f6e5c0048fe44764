//! Every method in every hard scene: each result must be correct, carry a warning or be refused.

mod bodies;
mod cell;
mod lips;
mod map;
mod method;
mod scenes;
mod study;

pub use study::StabilityStudy;
