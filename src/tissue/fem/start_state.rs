//! An equilibrium kept as the start of another path.

use super::checkpoint::{flags, pairs};
use super::error::SolveError;
use super::solver::{Solver, State};
use prosopon_geometry::{Motion, Vector};

/// An equilibrium of a mesh under moved bone; the default value has no nodes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StartState {
    /// Values of the generalised nodes, mm.
    x: Vec<Vector>,
    /// Motion of the moving segments from rest.
    motions: Vec<(u32, Motion)>,
    /// Pairs of contact point and body whose contact is switched off.
    released: Vec<u64>,
}

impl StartState {
    /// Motion of the moving segments from rest.
    #[must_use]
    pub fn motions(&self) -> &[(u32, Motion)] {
        &self.motions
    }

    /// Memory it occupies, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (self.x.len() * size_of::<Vector>() + self.motions.len() * size_of::<(u32, Motion)>()) as u64
    }
}

impl Solver<'_> {
    /// The current equilibrium.
    #[must_use]
    pub fn start_state(&self) -> StartState {
        let released = pairs(self.equations.contact.released());
        StartState { x: self.state.x.clone(), motions: self.state.motions.clone(), released }
    }

    /// Starts from an equilibrium of the same mesh and elements, at path parameter 0.
    ///
    /// Nodes that are held now but were free then move to their prescribed positions in the next step. Contact pressures are
    /// computed anew.
    ///
    /// # Errors
    /// [`SolveError::Problem`] when `saved` has another number of generalised nodes.
    pub fn start_from(&mut self, saved: &StartState) -> Result<(), SolveError> {
        let (found, needed) = (saved.x.len(), self.state.x.len());
        if found != needed {
            let detail = format!("the start state has {found} generalised nodes, the mesh has {needed}");
            return Err(SolveError::Problem { detail });
        }
        // With other attachments there may be other contact points.
        let known = self.equations.contact.released().len();
        if let Some(released) = flags(&saved.released, known) {
            self.equations.contact.set_released(released);
        }
        self.state = State { t: 0.0, x: saved.x.clone(), motions: saved.motions.clone() };
        // The factor at rest is a poor preconditioner here.
        self.equations.solver.refresh();
        Ok(())
    }
}
