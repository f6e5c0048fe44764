//! An equilibrium kept, for another path to begin at.

use super::checkpoint::{flags, pairs};
use super::error::SolveError;
use super::solver::{Solver, State};
use prosopon_geometry::{Motion, Vector};

/// An equilibrium of a mesh under bone that has moved; by default one of no mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SavedState {
    /// Values of the generalised nodes, mm.
    x: Vec<Vector>,
    /// Motion of moving segments from rest.
    motions: Vec<(u32, Motion)>,
    /// Pairs of contact point and body that do not push any more.
    released: Vec<u64>,
}

impl SavedState {
    /// Motion of moving segments from rest.
    #[must_use]
    pub fn motions(&self) -> &[(u32, Motion)] {
        &self.motions
    }

    /// What it takes in memory, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (self.x.len() * size_of::<Vector>() + self.motions.len() * size_of::<(u32, Motion)>()) as u64
    }
}

impl Solver<'_> {
    /// The present equilibrium.
    #[must_use]
    pub fn save(&self) -> SavedState {
        let released = pairs(self.equations.contact.released());
        SavedState { x: self.state.x.clone(), motions: self.state.motions.clone(), released }
    }

    /// Takes up an equilibrium of the same mesh and elements, at path parameter 0: what follows goes on from there. Nodes that are held now and
    /// were not then go to where they are held with the next step; contact pressures are found anew.
    ///
    /// # Errors
    /// [`SolveError::Problem`] when it has another number of generalised nodes.
    pub fn resume(&mut self, saved: &SavedState) -> Result<(), SolveError> {
        let (found, needed) = (saved.x.len(), self.state.x.len());
        if found != needed {
            let detail = format!("the state to begin at has {found} generalised nodes, the mesh {needed}");
            return Err(SolveError::Problem { detail });
        }
        // Of another attachment there may be other contact points.
        let known = self.equations.contact.released().len();
        if let Some(released) = flags(&saved.released, known) {
            self.equations.contact.set_released(released);
        }
        self.state = State { t: 0.0, x: saved.x.clone(), motions: saved.motions.clone() };
        // The factor at rest says little here.
        self.equations.solver.refresh();
        Ok(())
    }
}
