//! Osteotomies and bone paths.
//!
//! Invariants: segments are closed solids; number 0 is the part of the skull that stays; paths are rigid.

mod autorotate;
mod blade;
mod bridge;
mod clearance;
mod complete;
mod cut;
mod cut_faces;
mod follow;
mod min_cut;
mod names;
mod overlap;
mod parting;
mod path;
mod propose;
mod separation;
mod shape;
mod sheet;
mod solid;
mod template;

pub use autorotate::CondylarAxis;
pub use bridge::Bridge;
pub use clearance::{Clearance, Protected, clearances};
pub use cut::{Osteotomy, Segment, cut};
pub use follow::{PathReport, PathSample, follow};
pub use names::name_segments;
pub use path::{Path, Plan};
pub use propose::{Proposal, propose};
pub use shape::{BoundedPlane, Cut, CutShape, Purpose};
pub use template::{Landmarks, Template, TemplateCall, TemplateCuts, TemplateFault, le_fort_1};

use prosopon_geometry::control::Cancelled;

/// Why a cut or a path is not usable.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Cuts do not touch bone.
    #[error("{}", missed(missed_by))]
    MissesBone {
        /// Every such cut.
        missed_by: Vec<Miss>,
    },
    /// The cuts leave the bone in one piece.
    #[error("the cuts do not part the bone: {}", told(bridges))]
    NotParted {
        /// What is left, the widest first; empty when only crumbs come off.
        bridges: Vec<Bridge>,
    },
    /// A template lacks landmarks.
    #[error("the template {template} lacks landmarks: {}", missing.join(", "))]
    MissingLandmarks {
        /// The template.
        template: &'static str,
        /// Their names.
        missing: Vec<&'static str>,
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

/// A cut that touches no bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Miss {
    /// Index of the cut.
    pub cut: usize,
    /// How a message calls it.
    pub label: String,
    /// Distance from the cut to the bone, mm.
    pub distance_mm: f64,
}

/// How far cuts are from the bone in words.
fn missed(missed_by: &[Miss]) -> String {
    let one = |Miss { label, distance_mm, .. }: &Miss| {
        if *distance_mm < 0.05 {
            return format!("{label} touches the bone's surface and goes through none of it");
        }
        format!("{label} misses the bone: its nearest point of the cut is {distance_mm:.1} mm away")
    };
    missed_by.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Every bridge in words.
fn told(bridges: &[Bridge]) -> String {
    if bridges.is_empty() {
        return "only crumbs below 100 mm³ come off".to_owned();
    }
    let places: Vec<String> = bridges.iter().map(Bridge::to_string).collect();
    format!("{} left: {}", if bridges.len() == 1 { "one bridge is" } else { "bridges are" }, places.join("; "))
}

#[cfg(test)]
mod cut_tests;
#[cfg(test)]
mod tests;
