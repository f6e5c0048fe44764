//! From a CT and a plan to the predicted face.
//!
//! [`surface`]: a CT to surfaces. [`phantom`]: the analytic head. [`plan`]: osteotomies and paths. [`evaluate`]: error maps and pictures.
//! [`simulate`]: from surfaces and a plan to steps of deformed skin.

pub mod evaluate;
pub mod phantom;
pub mod plan;
pub mod simulate;
pub mod surface;
