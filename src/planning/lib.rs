//! Predicts the face after jaw surgery from a CT and a plan.
//!
//! [`surface`] extracts surfaces from a CT, and [`phantom`] provides an analytic head for tests.
//! [`plan`] holds osteotomies and paths. [`simulate`] computes the steps of deformed skin from surfaces and a plan.
//! [`evaluate`] computes error maps and pictures.

pub mod evaluate;
pub mod phantom;
pub mod plan;
pub mod simulate;
pub mod surface;
