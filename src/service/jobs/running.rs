use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use tracing::Span;

use super::forecast::Forecast;
use prosopon_contract::WarningDocument;
use prosopon_geometry::control::Control;
use prosopon_store::{JobId, JobRecord, Lane, SessionId};

/// Names of all phases of a job, in order.
pub fn phase_names() -> impl Iterator<Item = &'static str> {
    std::iter::once("waiting").chain(Phase::ALL.map(Phase::as_str)).chain(std::iter::once("done"))
}

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
    Estimate,
    Compare,
    Writing,
}

impl Phase {
    const ALL: [Self; 9] = [
        Self::Reading,
        Self::Surfaces,
        Self::Field,
        Self::Cut,
        Self::Mesh,
        Self::Solve,
        Self::Estimate,
        Self::Compare,
        Self::Writing,
    ];

    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Reading => "reading",
            Self::Surfaces => "surfaces",
            Self::Field => "field",
            Self::Cut => "cut",
            Self::Mesh => "mesh",
            Self::Solve => "solve",
            Self::Estimate => "estimate",
            Self::Compare => "compare",
            Self::Writing => "writing",
        }
    }

    /// The stage with the engine's name; unknown ones count as solving.
    pub(super) fn of_stage(name: &str) -> Self {
        Self::ALL.into_iter().find(|p| p.as_str() == name).unwrap_or(Self::Solve)
    }
}

/// Warning of step `k` as the job shows it.
pub(super) fn step_warning(k: u32, warning: &WarningDocument) -> WarningDocument {
    warning.about(format_args!("step {k}"))
}

fn stage_span(job: &Span, phase: Phase) -> Span {
    tracing::info_span!(parent: job, "stage", stage = phase.as_str())
}

/// Seconds since the first call.
fn seconds() -> f64 {
    static BEGIN: OnceLock<Instant> = OnceLock::new();
    BEGIN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// A worker: it runs one job of its lane at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Worker {
    pub(super) lane: Lane,
    /// From 0 within its lane.
    pub(super) number: usize,
}

impl Worker {
    /// All workers of a service with `parallel_jobs` workers in the heavy lane and one in the quick lane.
    pub(super) fn all(parallel_jobs: usize) -> Vec<Self> {
        let in_lane = |lane| match lane {
            Lane::Heavy => parallel_jobs.max(1),
            Lane::Quick => 1,
        };
        Lane::ALL.into_iter().flat_map(|lane| (0..in_lane(lane)).map(move |number| Self { lane, number })).collect()
    }
}

/// Time between two looks for a stop.
const LOOK_FOR_STOP: Duration = Duration::from_millis(50);
/// Time that a computation has to see a client's cancellation before the job ends without it.
const SEES_CANCEL: Duration = Duration::from_millis(500);
/// The same for the deadline and the end of the service, at which a computation may still store what it has.
const SEES_STOP: Duration = Duration::from_secs(2);

const OPEN: u8 = 0;
const CANCEL_REQUESTED: u8 = 1;
const CLOSED: u8 = 2;
const COMPUTES_ON: u8 = 3;

/// A running job, as shared between its worker and the rest of the service.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) job: JobId,
    pub(super) session: SessionId,
    pub(super) other_session: Option<SessionId>,
    pub(super) worker: Worker,
    pub(super) control: Control,
    pub(super) started: Instant,
    phase: AtomicU8,
    /// Open, cancellation requested, closed, or closed while the computation has not seen the cancellation.
    ///
    /// Whichever comes first, cancellation or end, wins: one atomic change.
    ending: AtomicU8,
    warnings: Mutex<Vec<WarningDocument>>,
    /// Step numbers and warnings; the steps' own events reported them.
    step_warnings: Mutex<Vec<(u32, WarningDocument)>>,
    /// When each stage began.
    stages: Mutex<Vec<(Phase, Instant)>>,
    /// Tracing span of the job.
    span: Span,
    stage_span: Mutex<Span>,
    forecast: Mutex<Forecast>,
    /// When a check first found that the job should stop.
    stop_seen: OnceLock<Instant>,
}

impl Running {
    /// A running job. Call it within the job's span.
    ///
    /// `most` is the longest computing time of any job; `memory_mb` is the memory that this job may add to the memory in use, MB.
    pub(super) fn new(job: &JobRecord, worker: Worker, most: Duration, memory_mb: f64) -> Self {
        let limit = job.max_wall_s.unwrap_or(f64::INFINITY).min(most.as_secs_f64());
        Self {
            job: job.id,
            session: job.session,
            other_session: job.other_session,
            worker,
            control: Control::new().with_clock(seconds).with_deadline(seconds() + limit).with_memory_mb(memory_mb),
            started: Instant::now(),
            phase: AtomicU8::new(Phase::Reading as u8),
            ending: AtomicU8::new(OPEN),
            warnings: Mutex::default(),
            step_warnings: Mutex::default(),
            stages: Mutex::new(vec![(Phase::Reading, Instant::now())]),
            span: Span::current(),
            stage_span: Mutex::new(stage_span(&Span::current(), Phase::Reading)),
            forecast: Mutex::new(Forecast::new(seconds())),
            stop_seen: OnceLock::new(),
        }
    }

    pub(super) fn set_phase(&self, phase: Phase) {
        self.forecast().begin_stage(seconds(), self.control.progress());
        self.phase.store(phase as u8, Ordering::Relaxed);
        self.stages.lock().unwrap_or_else(PoisonError::into_inner).push((phase, Instant::now()));
        *self.stage_span.lock().unwrap_or_else(PoisonError::into_inner) = stage_span(&self.span, phase);
    }

    /// Time of each stage so far, s.
    pub(super) fn stage_seconds(&self) -> Vec<(&'static str, f64)> {
        let stages = self.stages.lock().unwrap_or_else(PoisonError::into_inner);
        let ends = stages.iter().skip(1).map(|(_, at)| *at).chain([Instant::now()]);
        stages.iter().zip(ends).map(|((phase, from), to)| (phase.as_str(), (to - *from).as_secs_f64())).collect()
    }

    /// Adds a warning of the job as a whole. The job's row gets it when the job succeeds, fails or is cancelled.
    pub(super) fn warn(&self, warning: WarningDocument) {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(warning);
    }

    /// Adds a warning of step `k`. The job's row gets it as it gets those of [`Running::warn`].
    pub(super) fn warn_of_step(&self, k: u32, warning: &WarningDocument) {
        let mut known = self.step_warnings.lock().unwrap_or_else(PoisonError::into_inner);
        let warning = (k, warning.clone());
        // A step may be solved twice.
        if !known.contains(&warning) {
            known.push(warning);
        }
    }

    /// Warnings of the job as a whole.
    pub(super) fn own_warnings(&self) -> Vec<WarningDocument> {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Warnings of the steps.
    pub(super) fn step_warnings(&self) -> Vec<(u32, WarningDocument)> {
        self.step_warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// All warnings; those of steps have the step's number.
    pub(super) fn warnings(&self) -> Vec<WarningDocument> {
        let mut all = self.own_warnings();
        let of_steps = self.step_warnings().into_iter().filter(|(_, warning)| !all.contains(warning));
        let of_steps: Vec<_> = of_steps.map(|(k, warning)| step_warning(k, &warning)).collect();
        all.extend(of_steps);
        all
    }

    pub(super) fn phase(&self) -> Phase {
        let stored = self.phase.load(Ordering::Relaxed);
        Phase::ALL.into_iter().find(|p| *p as u8 == stored).unwrap_or(Phase::Reading)
    }

    /// Cancels the computation for good; false when the job has reached its end already.
    ///
    /// A cancelled control without this request means that the service stops or that the time limit is reached.
    pub(super) fn request_cancel(&self) -> bool {
        let before = self.ending.compare_exchange(OPEN, CANCEL_REQUESTED, Ordering::AcqRel, Ordering::Acquire);
        if matches!(before, Err(CLOSED | COMPUTES_ON)) {
            return false;
        }
        self.control.cancel();
        true
    }

    /// Marks the end of the work; false when the job was cancelled before.
    pub(super) fn close(&self) -> bool {
        self.ending.swap(CLOSED, Ordering::AcqRel) == OPEN
    }

    /// Waits until a stop has been ignored too long: a client's cancellation, the deadline, or the end of the service.
    pub(super) async fn ignores_stop(&self) {
        while !self.control.is_cancelled() {
            tokio::time::sleep(LOOK_FOR_STOP).await;
        }
        // From here on the time counts for which the computation ignores the stop.
        self.stop_seen.get_or_init(Instant::now);
        if self.ending.load(Ordering::Acquire) == CANCEL_REQUESTED {
            tokio::time::sleep(SEES_CANCEL).await;
        } else {
            tokio::time::sleep(SEES_STOP).await;
        }
    }

    /// Notes that the end of the job is stored although its computation goes on.
    pub(super) fn computes_on(&self) {
        self.ending.store(COMPUTES_ON, Ordering::Release);
    }

    /// Whether the job belongs to this session or reads it.
    pub(super) fn reads(&self, session: SessionId) -> bool {
        self.session == session || self.other_session == Some(session)
    }

    /// How long the work has ignored a stop.
    pub(super) fn ignoring_stop(&self) -> Duration {
        if !self.control.is_cancelled() || self.ending.load(Ordering::Acquire) == CLOSED {
            return Duration::ZERO;
        }
        self.stop_seen.get_or_init(Instant::now).elapsed()
    }

    /// Estimate of the remaining time, s; `None` before there is progress.
    ///
    /// Call it about once a second: it records the progress.
    pub(super) fn eta_s(&self) -> Option<f64> {
        let mut forecast = self.forecast();
        forecast.see(seconds(), self.control.progress());
        forecast.left_s(seconds())
    }

    fn forecast(&self) -> std::sync::MutexGuard<'_, Forecast> {
        self.forecast.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
