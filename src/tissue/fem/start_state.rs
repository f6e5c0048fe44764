//! An equilibrium kept as the start of another path.

use super::error::SolveError;
use super::flags::{flags, pairs};
use super::solver::Solver;
use super::state::PathPoint;
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
    /// Gliding nodes that have been pulled off, by spring.
    pulled_off: Vec<u64>,
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
        let released = pairs(self.equations.state.contact.released());
        let pulled_off = pairs(&self.equations.state.springs.memory().released);
        StartState { x: self.reached.x.clone(), motions: self.reached.motions.clone(), released, pulled_off }
    }

    /// Starts from an equilibrium of the same mesh and elements, at path parameter 0.
    ///
    /// Nodes that are held now but were free then move to their prescribed positions in the next step. Contact pressures are
    /// computed anew.
    ///
    /// # Errors
    /// [`SolveError::Problem`] when `start` has another number of generalised nodes.
    pub fn start_from(&mut self, start: &StartState) -> Result<(), SolveError> {
        let (found, needed) = (start.x.len(), self.reached.x.len());
        if found != needed {
            let detail = format!("the start state has {found} generalised nodes, the mesh has {needed}");
            return Err(SolveError::Problem { detail });
        }
        // With other attachments there may be other contact points.
        let known = self.equations.state.contact.released().len();
        if let Some(released) = flags(&start.released, known) {
            self.equations.state.contact.set_released(released);
        }
        self.equations.state.springs.set_pulled_off(&start.pulled_off);
        self.reached = PathPoint { t: 0.0, x: start.x.clone(), motions: start.motions.clone() };
        // The factor at rest is a poor preconditioner here.
        self.equations.work.solver_mut().refresh();
        Ok(())
    }
}
