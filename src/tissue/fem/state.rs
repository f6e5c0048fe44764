//! What changes along a path: contact with its multipliers, the last contact forces, and the history of the iterations.

use super::contact::{Contact, PairIndex};
use super::report::IterationRecord;
use super::springs::Springs;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

/// An equilibrium at path parameter `t`.
#[derive(Debug, Clone)]
pub(super) struct PathPoint {
    pub(super) t: f64,
    /// Values of the generalised nodes, mm.
    pub(super) x: Vec<Vector>,
    /// Motion of the moving segments from rest.
    pub(super) motions: Vec<(u32, Motion)>,
}

/// Purpose of a step, which decides its tolerances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Purpose {
    /// Something is measured on the equilibrium: the tolerances of the settings hold.
    #[default]
    Measurement,
    /// The equilibrium is only displayed.
    Display,
}

/// Contact and history of a path.
#[derive(Debug)]
pub(super) struct PathState<'a> {
    pub(super) contact: Contact<'a>,
    pub(super) springs: Springs<'a>,
    /// Active pairs of contact point and body in the last quadratic model, ascending.
    pub(super) active: Vec<PairIndex>,
    /// Contact forces by unknown node from the last converged condensed contact solve, ascending, N.
    pub(super) contact_forces: Vec<(u32, Vector)>,
    /// Share of the loads and prescribed displacements that is applied.
    pub(super) load_share: f64,
    /// Purpose of the present step.
    pub(super) purpose: Purpose,
    /// Whether contact is solved on the condensed system before each Newton direction.
    pub(super) uses_condensed: bool,
    /// Stop flag and deadline of the present step.
    pub(super) control: Control,
    /// Newton iterations of the present step.
    pub(super) records: Vec<IterationRecord>,
    /// The last iterate of Newton's method when it failed; otherwise empty.
    failed_at: Vec<Vector>,
}

impl<'a> PathState<'a> {
    /// The state at rest.
    pub(super) fn new(contact: Contact<'a>, springs: Springs<'a>) -> Self {
        Self {
            contact,
            springs,
            active: Vec::new(),
            contact_forces: Vec::new(),
            load_share: 0.0,
            purpose: Purpose::default(),
            uses_condensed: true,
            control: Control::new(),
            records: Vec::new(),
            failed_at: Vec::new(),
        }
    }

    /// Forgets the last failure and uses the condensed contact solve again.
    pub(super) fn begin_attempt(&mut self) {
        self.failed_at.clear();
        self.uses_condensed = true;
    }

    /// Records the iterate at which Newton's method failed.
    pub(super) fn set_failed(&mut self, x: &[Vector]) {
        self.failed_at = x.to_vec();
    }

    /// The last iterate of Newton's method when it failed.
    pub(super) fn last_iterate(&self) -> Option<&[Vector]> {
        (!self.failed_at.is_empty()).then_some(self.failed_at.as_slice())
    }
}
