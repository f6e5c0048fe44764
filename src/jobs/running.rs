use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use crate::control::Control;
use crate::store::JobId;

/// Stage of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Phase {
    Reading,
    Surfaces,
    Field,
    Cut,
    Mesh,
    Solve,
    Writing,
}

impl Phase {
    const ALL: [Self; 7] =
        [Self::Reading, Self::Surfaces, Self::Field, Self::Cut, Self::Mesh, Self::Solve, Self::Writing];

    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::Surfaces => "surfaces",
            Self::Field => "field",
            Self::Cut => "cut",
            Self::Mesh => "mesh",
            Self::Solve => "solve",
            Self::Writing => "writing",
        }
    }

    /// The stage with the engine's name; unknown ones count as solving.
    pub(super) fn of_stage(name: &str) -> Self {
        Self::ALL.into_iter().find(|p| p.as_str() == name).unwrap_or(Self::Solve)
    }
}

/// Seconds since the first call.
fn seconds() -> f64 {
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    BEGIN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// The job that is being computed, as seen by everyone else.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) job: JobId,
    pub(super) control: Control,
    pub(super) started: Instant,
    phase: AtomicU8,
    cancel_requested: AtomicBool,
    warnings: Mutex<Vec<String>>,
}

impl Running {
    pub(super) fn new(job: JobId) -> Self {
        Self {
            job,
            control: Control::new().with_clock(seconds),
            started: Instant::now(),
            phase: AtomicU8::new(Phase::Reading as u8),
            cancel_requested: AtomicBool::new(false),
            warnings: Mutex::default(),
        }
    }

    pub(super) fn set_phase(&self, phase: Phase) {
        self.phase.store(phase as u8, Ordering::Relaxed);
    }

    /// Keeps a warning for the job's row, however the job ends.
    pub(super) fn warn(&self, text: String) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    pub(super) fn warnings(&self) -> Vec<String> {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn phase(&self) -> Phase {
        let stored = self.phase.load(Ordering::Relaxed);
        Phase::ALL.into_iter().find(|p| *p as u8 == stored).unwrap_or(Phase::Reading)
    }

    /// Stops the computation for good; without this, a cancelled control means that the service stops.
    pub(super) fn request_cancel(&self) {
        self.cancel_requested.store(true, Ordering::Relaxed);
        self.control.cancel();
    }

    pub(super) fn cancel_requested(&self) -> bool {
        self.cancel_requested.load(Ordering::Relaxed)
    }

    /// Time left when the rest goes as the part that is done, s; none before there is something to go by.
    pub(super) fn eta_s(&self) -> Option<f64> {
        let done = self.control.progress();
        let elapsed = self.started.elapsed().as_secs_f64();
        (done > 0.03).then(|| elapsed * (1.0 - done) / done)
    }
}
