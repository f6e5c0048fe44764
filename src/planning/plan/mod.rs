//! Osteotomies and bone paths.
//!
//! Invariants: segments are closed solids; segment 0 is the skull, which is fixed; paths are rigid motions.

mod arch;
mod assign;
mod autorotate;
mod bridge;
mod checked_cut;
mod clearance;
mod cut;
mod cut_faces;
mod follow;
mod lattice;
mod min_cut;
mod moved_solid;
mod names;
mod orient;
mod osteotomy;
mod overlap;
mod part_bridges;
mod path;
mod pieces;
mod propose;
mod separation;
mod shape;
mod sheet;
mod solid;
mod teeth;
mod template;
mod tuning;

pub use arch::DentalArch;
pub use autorotate::CondylarAxis;
pub use bridge::Bridge;
pub use clearance::{Clearance, Protected, clearances};
pub use cut::{cut, try_cuts};
pub use follow::{PathReport, PathSample, follow, outline};
pub use names::name_segments;
pub use osteotomy::{Osteotomy, Segment};
pub use path::{Path, Plan};
pub(crate) use propose::measured_accuracy_mm;
pub use propose::{Proposal, propose};
pub use shape::{BoundedPlane, Cut, CutShape, Purpose};
pub use teeth::Teeth;
pub use template::{Landmarks, Template, TemplateCall, TemplateCuts, TemplateError, le_fort_1};

use prosopon_geometry::control::Cancelled;

/// Why cuts, templates or paths cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Cuts do not pass through bone.
    #[error("{}", missed(missed_by))]
    MissesBone {
        /// Each cut that misses the bone, in the order of the cuts.
        missed_by: Vec<Miss>,
    },
    /// The cuts leave the bone in one piece.
    #[error("the cuts do not part the bone: {}", remaining(bridges))]
    NotParted {
        /// Bridges that remain, by falling cross-section; empty when only fragments below 100 mm³ come off.
        bridges: Vec<Bridge>,
    },
    /// A template lacks landmarks.
    #[error("template {template} lacks landmarks: {}; place them and send them with the template", missing.join(", "))]
    MissingLandmarks {
        /// Name of the template in the API.
        template: &'static str,
        /// Names of the landmarks.
        missing: Vec<&'static str>,
    },
    /// A cut has a value that is not allowed, or cannot be used together with the others.
    #[error("{label}: {detail}")]
    Cut {
        /// Index of the cut in the list of cuts.
        cut: usize,
        /// Name of the cut in messages, from [`Cut::label`].
        label: String,
        /// Place of the value in the cut, for example `polyline.direction`; empty when it is the cut as a whole.
        field: &'static str,
        /// What was found and what is allowed.
        detail: String,
    },
    /// A value is not allowed.
    #[error("{what}: {detail}")]
    Value {
        /// Place of the value in the request, for example `waypoints[2].t`.
        what: String,
        /// What was found and what is allowed.
        detail: String,
    },
    /// The caller cancelled the computation.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A cut that passes through no bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Miss {
    /// Index of the cut in the list of cuts.
    pub cut: usize,
    /// Name of the cut in messages, from [`Cut::label`].
    pub label: String,
    /// Distance from the cut to the bone, mm.
    pub distance_mm: f64,
}

/// Text of [`PlanError::MissesBone`]: each cut with its distance from the bone.
fn missed(missed_by: &[Miss]) -> String {
    let one = |Miss { label, distance_mm, .. }: &Miss| {
        if *distance_mm < 0.05 {
            return format!("{label} touches the surface of the bone but does not enter it; move it into the bone");
        }
        format!("{label} misses the bone by {distance_mm:.1} mm; move or enlarge it")
    };
    missed_by.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// Text of [`PlanError::NotParted`]: each bridge with its size and place.
fn remaining(bridges: &[Bridge]) -> String {
    if bridges.is_empty() {
        return "only fragments below 100 mm³ come off; move the cuts deeper into the bone".to_owned();
    }
    let places: Vec<String> = bridges.iter().map(Bridge::to_string).collect();
    format!(
        "{} left: {}; extend the cuts there",
        if bridges.len() == 1 { "one bridge is" } else { "bridges are" },
        places.join("; ")
    )
}

#[cfg(test)]
mod cut_tests;
#[cfg(test)]
mod follow_tests;
#[cfg(test)]
mod tests;
