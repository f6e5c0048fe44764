//! Every method against every hard scene: converged, helped, told or refused, and never silently wrong.

mod bodies;
mod cell;
mod map;
mod method;
mod scenes;
mod study;

pub use study::StabilityStudy;
