use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::running::Running;
use super::state::{JobEvent, next};
use super::{CpuPool, worker};
use crate::control::Control;
use crate::import::Limits;
use crate::session::{Engine, Fault, FaultKind, Halt, StepDocument};
use crate::store::{
    AnswerRecord, Insertion, JobChange, JobId, JobKind, JobRecord, JobState, SessionId, StepRecord, Store, now_rfc3339,
};

/// Bounds of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServiceSettings {
    /// Jobs that may wait.
    pub max_waiting: u32,
    /// Times that a job is started before it is given up.
    pub max_attempts: u32,
    /// What an upload may hold.
    pub import: Limits,
}

impl Default for ServiceSettings {
    fn default() -> Self {
        Self { max_waiting: 64, max_attempts: 3, import: Limits::default() }
    }
}

/// Sessions and jobs over one store, one engine and one CPU pool.
#[derive(Debug)]
pub struct Service {
    pub(super) store: Store,
    pub(super) engine: Arc<dyn Engine>,
    pub(super) cpu: CpuPool,
    pub(super) settings: ServiceSettings,
    /// A job was accepted.
    pub(super) wake: Notify,
    pub(super) running: Mutex<Option<Arc<Running>>>,
    /// Counts up whenever an event was stored.
    pub(super) changes: watch::Sender<u64>,
    pub(super) stop: CancellationToken,
    worker: Mutex<Option<JoinHandle<()>>>,
}

/// How a job stands now.
#[derive(Debug, Clone, PartialEq)]
pub struct JobStatus {
    /// Its row; phase and progress are live while it runs.
    pub record: JobRecord,
    /// Finished steps, the last one's report among them.
    pub steps_done: u32,
    /// Time left, s.
    pub eta_s: Option<f64>,
    /// Jobs before it.
    pub queue_position: Option<u32>,
    /// Relative residual of each finished step.
    pub residuals: Vec<f64>,
}

impl Service {
    /// Takes up what an earlier run left, and starts to work.
    ///
    /// # Errors
    /// The store's.
    pub async fn start(
        store: Store,
        engine: Arc<dyn Engine>,
        cpu: CpuPool,
        settings: ServiceSettings,
    ) -> Result<Arc<Self>, Fault> {
        let service = Arc::new(Self {
            store,
            engine,
            cpu,
            settings,
            wake: Notify::new(),
            running: Mutex::new(None),
            changes: watch::Sender::new(0),
            stop: CancellationToken::new(),
            worker: Mutex::new(None),
        });
        worker::recover(&service).await?;
        service.store.forget_old_answers(7).await?;
        let handle = tokio::spawn(worker::work_through(Arc::clone(&service)));
        *service.worker.lock().unwrap_or_else(PoisonError::into_inner) = Some(handle);
        Ok(service)
    }

    /// The store.
    #[must_use]
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Bounds.
    #[must_use]
    pub fn settings(&self) -> &ServiceSettings {
        &self.settings
    }

    /// The numerics.
    #[must_use]
    pub fn engine(&self) -> &Arc<dyn Engine> {
        &self.engine
    }

    /// Stops taking jobs, interrupts the running one and waits for it, at most `grace`.
    pub async fn shut_down(&self, grace: Duration) {
        self.stop.cancel();
        if let Some(running) = self.running() {
            running.control.cancel();
        }
        let worker = self.worker.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(worker) = worker
            && tokio::time::timeout(grace, worker).await.is_err()
        {
            tracing::warn!("the running job did not stop in time; the next start takes it up");
        }
    }

    /// Whether the service is stopping; cancelled futures of this token end streams.
    #[must_use]
    pub fn stopping(&self) -> &CancellationToken {
        &self.stop
    }

    pub(super) fn running(&self) -> Option<Arc<Running>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn announce(&self) {
        self.changes.send_modify(|n| *n += 1);
    }

    /// Tells when events were stored.
    #[must_use]
    pub fn watch_changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Runs short work of a request on the threads for requests; it is told to stop when the caller leaves.
    ///
    /// # Errors
    /// What the work says, or [`FaultKind::Internal`] when it panics.
    pub async fn compute<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Engine, &Control) -> Result<T, Halt> + Send + 'static,
    ) -> Result<T, Fault> {
        let control = Control::new();
        let _cancel_on_leave = CancelOnDrop(control.clone());
        let engine = Arc::clone(&self.engine);
        let done = self.cpu.run_request(move || work(engine.as_ref(), &control)).await;
        Ok(done.map_err(|_| panicked())??)
    }

    /// Stores a new job; one that the session has already and that has not ended is taken instead. `answer` makes what a
    /// repeated request gets from the job as stored.
    ///
    /// # Errors
    /// [`FaultKind::QueueFull`], [`FaultKind::ShuttingDown`], or the store's.
    pub async fn accept(
        &self,
        session: SessionId,
        kind: JobKind,
        steps: u32,
        request: String,
        answer: impl FnOnce(&JobRecord) -> Option<AnswerRecord>,
    ) -> Result<JobRecord, Fault> {
        if self.stop.is_cancelled() {
            return Err(Fault::new(FaultKind::ShuttingDown, "the service is stopping"));
        }
        let job = JobRecord {
            number: 0,
            id: JobId::new(),
            session,
            kind,
            state: JobState::Accepted,
            phase: "waiting".to_owned(),
            progress: 0.0,
            steps,
            attempt: 0,
            request,
            report: None,
            fault: None,
            warnings: Vec::new(),
            rest_blob: None,
            tissue_blob: None,
            created_at: now_rfc3339(),
            started_at: None,
            finished_at: None,
        };
        let max = self.settings.max_waiting;
        let stopping = self.running().filter(|r| r.cancel_requested()).map(|r| r.job);
        match self.store.insert_job(&job, max, &status_event(JobState::Accepted, 0), stopping, answer).await? {
            Insertion::Stored => {}
            Insertion::Twin(twin) => return Ok(*twin),
            Insertion::Full => {
                let detail = format!("{max} jobs wait already; try again later");
                return Err(Fault::new(FaultKind::QueueFull, detail));
            }
        }
        tracing::info!(job.id = %job.id, job.kind = kind.as_str(), session.id = %session, "job accepted");
        self.announce();
        self.wake.notify_one();
        Ok(job)
    }

    /// A job's row.
    ///
    /// # Errors
    /// [`FaultKind::NotFound`], [`FaultKind::Gone`], or the store's.
    pub async fn job(&self, id: JobId) -> Result<JobRecord, Fault> {
        match self.store.job(id).await? {
            Some(job) => Ok(job),
            None if self.store.is_deleted(&id.to_string()).await? => {
                Err(Fault::new(FaultKind::Gone, format!("job {id} was deleted with its session")))
            }
            None => Err(Fault::new(FaultKind::NotFound, format!("there is no job {id}"))),
        }
    }

    /// How a job stands now.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn status(&self, id: JobId) -> Result<JobStatus, Fault> {
        let record = self.job(id).await?;
        self.status_of(record).await
    }

    /// How the job of a row stands now.
    ///
    /// # Errors
    /// The store's.
    pub async fn status_of(&self, mut record: JobRecord) -> Result<JobStatus, Fault> {
        let steps = self.store.steps(record.id).await?;
        let running = self.running().filter(|r| r.job == record.id && record.state == JobState::Running);
        if let Some(running) = &running {
            running.phase().as_str().clone_into(&mut record.phase);
            record.progress = running.control.progress();
            record.warnings.extend(running.warnings());
        }
        let queue_position = if record.state == JobState::Accepted {
            Some(self.store.waiting(record.number).await?.1 + u32::from(self.running().is_some()))
        } else {
            None
        };
        Ok(JobStatus {
            steps_done: u32::try_from(steps.len()).unwrap_or(u32::MAX),
            residuals: steps.iter().map(residual).collect::<Result<_, _>>()?,
            eta_s: running.and_then(|r| r.eta_s()),
            queue_position,
            record,
        })
    }

    /// Waits until a job has ended, at most `patience`, and says how it stands.
    ///
    /// # Errors
    /// As [`Service::job`].
    pub async fn wait(&self, id: JobId, patience: Duration) -> Result<JobStatus, Fault> {
        let mut changes = self.watch_changes();
        let ended = async {
            loop {
                changes.borrow_and_update();
                if self.job(id).await?.state.has_ended() {
                    return Ok::<(), Fault>(());
                }
                tokio::select! {
                    changed = changes.changed() => if changed.is_err() { return Ok(()) },
                    () = self.stop.cancelled() => return Ok(()),
                }
            }
        };
        if let Ok(result) = tokio::time::timeout(patience, ended).await {
            result?;
        }
        self.status(id).await
    }

    /// Asks a job to stop. One that waits is cancelled at once, one that runs within a Newton iteration.
    ///
    /// # Errors
    /// [`FaultKind::WrongState`] when it has ended; as [`Service::job`].
    pub async fn cancel(&self, id: JobId) -> Result<JobStatus, Fault> {
        // It may start between the look and the change: then look again.
        loop {
            let job = self.job(id).await?;
            if job.state.has_ended() {
                let detail = format!("the job has ended: it is {}", job.state);
                return Err(Fault::new(FaultKind::WrongState, detail).with("job_status", job.state.as_str()));
            }
            if let Some(running) = self.running().filter(|r| r.job == id) {
                running.request_cancel();
                return self.status(id).await;
            }
            let change = JobChange { events: vec![end_event(JobState::Cancelled, None)], ..JobChange::default() };
            if let Ok(to) = next(job.state, JobEvent::Cancel)
                && self.store.change_job(id, job.state, to, &change).await?
            {
                self.announce();
                return self.status(id).await;
            }
            tokio::task::yield_now().await;
        }
    }

    /// Deletes a session with everything in it and stops its running job.
    ///
    /// # Errors
    /// The store's.
    pub async fn delete_session(&self, id: SessionId) -> Result<bool, Fault> {
        if let Some(running) = self.running()
            && self.store.job(running.job).await?.is_some_and(|job| job.session == id)
        {
            running.request_cancel();
        }
        let deleted = self.store.delete_session(id).await?;
        self.announce();
        Ok(deleted)
    }
}

fn residual(step: &StepRecord) -> Result<f64, Fault> {
    let document = serde_json::from_str::<StepDocument>(&step.document).map_err(|error| {
        tracing::error!(%error, "the document of a step cannot be read");
        Fault::new(FaultKind::Internal, "a stored document cannot be read; the log says more")
    })?;
    Ok(document.relative_residual)
}

struct CancelOnDrop(Control);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

pub(super) fn panicked() -> Fault {
    Fault::new(FaultKind::Internal, "a computation broke off; the log says more")
}

pub(super) fn status_event(state: JobState, attempt: u32) -> String {
    serde_json::json!({ "status": state.as_str(), "attempt": attempt }).to_string()
}

pub(super) fn warning_event(text: &str) -> (&'static str, String) {
    ("warning", serde_json::json!({ "text": text }).to_string())
}

/// The last event of a job.
pub(super) fn end_event(state: JobState, fault: Option<&Fault>) -> (&'static str, String) {
    ("end", serde_json::json!({ "status": state.as_str(), "fault": fault }).to_string())
}
