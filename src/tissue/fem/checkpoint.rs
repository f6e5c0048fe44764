//! Checkpoints: all that the steps after an equilibrium depend on, so that another solver continues with the same bits.

use super::contact::PairIndex;
use super::equations::Equations;
use super::error::SolveError;
use super::factor_origin::{FactorOrigin, numbers, vectors};
use super::flags::{flags, pairs};
use super::solver::Solver;
use super::springs::SpringMemory;
use super::state::PathPoint;
use super::workspace::FactorState;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use prosopon_geometry::{Motion, Vector};

/// A rigid motion as numbers: translation, mm, then the unit quaternion's i, j, k and w.
pub type MotionNumbers = [f64; 7];

/// Checkpoint of a solver within a path, as plain numbers.
///
/// Beside the equilibrium it holds what the bits of later steps depend on: contact pressures, the state at which the current
/// factor was assembled, and the substep length.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Path parameter.
    pub t: f64,
    /// Values of the generalised nodes, mm.
    pub x: Vec<[f64; 3]>,
    /// Motion of the moving segments from rest.
    pub motions: Vec<(u32, MotionNumbers)>,
    /// Length of the last substep that converged, as a share of the path.
    pub substep: f64,
    /// Whether stable materials have replaced those requested.
    pub stabilised: bool,
    /// Whether passage through bone, and slipping round a rim, have been reported in a warning.
    pub warned_passage: [bool; 2],
    /// Contact stiffness, MPa/mm.
    pub contact_stiffness: f64,
    /// Non-zero multipliers by pair of contact point and body, then by point of facing tissue, MPa.
    pub multipliers: Vec<(u64, f64)>,
    /// Pairs of contact point and body whose contact is switched off.
    pub released: Vec<u64>,
    /// Stiffness of gliding, MPa/mm.
    pub spring_stiffness: f64,
    /// Multiplier of each spring, MPa.
    pub spring_multipliers: Vec<f64>,
    /// Springs whose nodes have been pulled off.
    pub pulled_off: Vec<u64>,
    /// Contact forces by unknown node from the last converged condensed contact solve, N.
    pub contact_forces: Vec<(u32, [f64; 3])>,
    /// Active pairs of contact point and body in the last quadratic model.
    pub active: Vec<(u64, u64)>,
    /// Whether factors are in double precision.
    pub double: bool,
    /// Origin of the current factor.
    pub factor: FactorOrigin,
    /// Extra iterations so far that were caused by the factor's age.
    pub extra_iterations: u64,
    /// Unknown nodes whose compliance is known, in the groups in which they were added.
    pub known_compliance: Vec<Vec<u32>>,
}

/// A motion as numbers.
#[must_use]
pub fn motion_numbers(motion: &Motion) -> MotionNumbers {
    let (t, q) = (motion.translation.vector, motion.rotation.coords);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
}

/// The motion of [`motion_numbers`], bit for bit.
#[must_use]
pub fn motion_of_numbers([x, y, z, i, j, k, w]: MotionNumbers) -> Motion {
    Motion::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k)))
}

impl Solver<'_> {
    /// Checkpoint after a step; `None` when the factor cannot be recomputed.
    ///
    /// A factor cannot be recomputed when it includes contact, because the elements alone are not stable.
    #[must_use]
    pub fn checkpoint(&self) -> Option<Checkpoint> {
        let (state, work) = (&self.equations.state, &self.equations.work);
        let FactorState { origin, known_compliance } = work.factor_state()?;
        let multipliers = state.contact.multipliers().iter().enumerate();
        Some(Checkpoint {
            t: self.reached.t,
            x: numbers(&self.reached.x),
            motions: self.reached.motions.iter().map(|(segment, motion)| (*segment, motion_numbers(motion))).collect(),
            substep: self.substep,
            stabilised: self.stabilised,
            warned_passage: self.warned_passage,
            contact_stiffness: state.contact.stiffness(),
            multipliers: multipliers.filter(|(_, p)| **p != 0.0).map(|(pair, p)| (pair as u64, *p)).collect(),
            released: pairs(state.contact.released()),
            spring_stiffness: state.springs.stiffness(),
            spring_multipliers: state.springs.memory().multipliers.clone(),
            pulled_off: pairs(&state.springs.memory().released),
            contact_forces: state.contact_forces.iter().map(|(node, force)| (*node, (*force).into())).collect(),
            active: state.active.iter().map(|pair| (pair.point as u64, pair.body as u64)).collect(),
            double: work.solver().is_double(),
            factor: origin,
            extra_iterations: work.solver().extra_iterations() as u64,
            known_compliance,
        })
    }

    /// Continues from a checkpoint of a solver over the same mesh, bodies and settings.
    ///
    /// Later steps have the same bits as those of that solver.
    ///
    /// # Errors
    /// [`SolveError::Checkpoint`] when it does not match; the solver must not be used afterwards.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<(), SolveError> {
        let misfit = |detail| SolveError::Checkpoint { detail };
        let nodes = self.reached.x.len();
        let fits = |x: &[[f64; 3]]| x.len() == nodes && x.iter().flatten().all(|c| c.is_finite());
        let origin_fits = match &checkpoint.factor {
            FactorOrigin::State { x, .. } => fits(x),
            FactorOrigin::Rest | FactorOrigin::Vertices(_) | FactorOrigin::Nothing => true,
        };
        if !fits(&checkpoint.x) || !origin_fits {
            return Err(misfit("it has another number of generalised nodes"));
        }
        let mut multipliers = vec![0.0; self.equations.state.contact.multipliers().len()];
        for (pair, pressure) in &checkpoint.multipliers {
            let pair = usize::try_from(*pair).ok().and_then(|pair| multipliers.get_mut(pair));
            *pair.ok_or_else(|| misfit("it has a contact point that does not exist"))? = *pressure;
        }
        let released = flags(&checkpoint.released, self.equations.state.contact.released().len())
            .ok_or_else(|| misfit("it has a contact point that does not exist"))?;
        self.equations.state.contact.set_released(released);
        let multipliers_of_springs = checkpoint.spring_multipliers.clone();
        let pulled_off = flags(&checkpoint.pulled_off, multipliers_of_springs.len());
        let memory = pulled_off.map(|released| SpringMemory { multipliers: multipliers_of_springs, released });
        memory
            .and_then(|memory| self.equations.state.springs.restore(checkpoint.spring_stiffness, memory))
            .ok_or_else(|| misfit("it has other gliding nodes"))?;
        if checkpoint.stabilised {
            self.equations.stabilise();
        }
        let Checkpoint { double, factor, known_compliance, .. } = checkpoint;
        let Equations { problem, state, work } = &mut self.equations;
        if *double {
            work.solver_mut().use_double();
        }
        // The memory may not suffice for double precision here.
        if work.solver().is_double() != *double {
            return Err(misfit("its factor differs"));
        }
        work.restore_factor(problem, factor, known_compliance).ok_or_else(|| misfit("its factor differs"))?;
        work.solver_mut().add_loss(usize::try_from(checkpoint.extra_iterations).unwrap_or(usize::MAX));
        state.contact.restore(checkpoint.contact_stiffness, multipliers);
        state.contact_forces = checkpoint.contact_forces.iter().map(|(n, f)| (*n, Vector::from(*f))).collect();
        state.active =
            checkpoint.active.iter().map(|(p, b)| PairIndex { point: *p as usize, body: *b as usize }).collect();
        let motions = checkpoint.motions.iter().map(|(segment, motion)| (*segment, motion_of_numbers(*motion)));
        self.reached = PathPoint { t: checkpoint.t, x: vectors(&checkpoint.x), motions: motions.collect() };
        self.substep = checkpoint.substep;
        self.stabilised = checkpoint.stabilised;
        self.warned_passage = checkpoint.warned_passage;
        self.forget_reported();
        Ok(())
    }
}
