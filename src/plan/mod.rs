//! Osteotomies and bone paths.
//!
//! Invariants: segments are closed solids; number 0 is the part of the skull that stays; paths are rigid.

mod bridge;
mod cut;
mod follow;
mod parting;
mod path;
mod separation;
mod solid;
mod template;

pub use cut::{BoundedPlane, Osteotomy, Segment, cut};
pub use follow::{PathReport, follow};
pub use path::{Path, Plan};
pub use template::le_fort_1;

use crate::control::Cancelled;

/// Why a cut or a path is not usable.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// A cut does not touch bone.
    #[error("cut {cut} misses the bone: its nearest point of the cut is {distance_mm:.1} mm away")]
    MissesBone {
        /// Index of the cut.
        cut: usize,
        /// Distance from the cut to the bone, mm.
        distance_mm: f64,
    },
    /// The cuts leave the bone in one piece.
    #[error("the cuts do not part the bone: {bridges} bridges are left, the widest near ({x:.1}, {y:.1}, {z:.1}) mm")]
    NotParted {
        /// Number of bridges found; 0 when not known.
        bridges: usize,
        /// Where the widest is.
        x: f64,
        /// Where the widest is.
        y: f64,
        /// Where the widest is.
        z: f64,
    },
    /// A value is out of range.
    #[error("{what}: {detail}")]
    Value {
        /// What is wrong, for example `waypoints[2].t`.
        what: String,
        /// Found and allowed.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

#[cfg(test)]
mod tests;
