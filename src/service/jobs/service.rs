use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::health::Beats;
use super::running::{Running, Worker};
use super::state::{JobEvent, next};
use super::{CpuPool, JobStatus, Order, ServiceSettings, janitor, others, worker};
use crate::trace;
use prosopon_contract::{Fault, FaultKind, Halt};
use prosopon_geometry::control::Control;
use prosopon_session::Engine;
use prosopon_store::{
    AnswerRecord, Audit, Insertion, JobChange, JobFilter, JobId, JobRecord, JobState, Lane, NewJob, SessionId, Store,
    Supersede, TenantId, WorkerId,
};

/// Sessions and jobs over one store, one engine and one CPU pool.
#[derive(Debug)]
pub struct Service {
    pub(super) store: Store,
    pub(super) engine: Arc<dyn Engine>,
    pub(super) cpu: CpuPool,
    pub(super) settings: ServiceSettings,
    pub(super) audit: Audit,
    /// Id of this process for others on the same store.
    pub(super) worker: WorkerId,
    /// Notified when a job was accepted, by lane.
    wake: [Notify; Lane::ALL.len()],
    running: Mutex<Vec<Arc<Running>>>,
    /// Incremented whenever an event was stored.
    pub(super) changes: watch::Sender<u64>,
    /// Cancelled when no job is begun any more.
    pub(super) drain: CancellationToken,
    pub(super) stop: CancellationToken,
    pub(super) beats: Beats,
    /// Workers that claim no job because the bucket refuses them.
    refused: Mutex<Vec<Worker>>,
    tasks: Mutex<Vec<JoinHandle<()>>>,
}

impl Service {
    /// Recovers the jobs of an earlier run and starts the workers and background tasks.
    ///
    /// # Errors
    /// The store's.
    pub async fn start(
        store: Store,
        engine: Arc<dyn Engine>,
        cpu: CpuPool,
        audit: Audit,
        settings: ServiceSettings,
    ) -> Result<Arc<Self>, Fault> {
        let stop = CancellationToken::new();
        let workers = if settings.works { Worker::all(settings.parallel_jobs) } else { Vec::new() };
        let service = Arc::new(Self {
            store: store.with_quota(settings.session_quota),
            engine,
            cpu,
            settings,
            audit,
            worker: WorkerId::new(),
            wake: Default::default(),
            running: Mutex::default(),
            changes: watch::Sender::new(0),
            drain: stop.child_token(),
            stop,
            beats: Beats::new(workers.clone()),
            refused: Mutex::default(),
            tasks: Mutex::default(),
        });
        service.check_audit_end().await?;
        // In a shared store, running jobs may belong to other processes; `take_over` waits for their leases to expire.
        let abandoned = if service.store.is_shared() { Vec::new() } else { service.store.abandoned().await? };
        worker::recover(&service, abandoned).await?;
        let mut tasks = vec![tokio::spawn(janitor::anchor_audit(Arc::clone(&service)))];
        if settings.keeps_house {
            tasks.push(tokio::spawn(janitor::keep_house(Arc::clone(&service))));
        }
        if service.store.is_shared() {
            tasks.push(tokio::spawn(others::follow(Arc::clone(&service))));
            tasks.push(tokio::spawn(others::take_over(Arc::clone(&service))));
        }
        tasks
            .extend(workers.into_iter().map(|worker| tokio::spawn(worker::work_through(Arc::clone(&service), worker))));
        *service.tasks.lock().unwrap_or_else(PoisonError::into_inner) = tasks;
        Ok(service)
    }

    /// The store.
    #[must_use]
    pub fn store(&self) -> &Store {
        &self.store
    }

    /// The limits and retention times.
    #[must_use]
    pub fn settings(&self) -> &ServiceSettings {
        &self.settings
    }

    /// The numerics.
    #[must_use]
    pub fn engine(&self) -> &Arc<dyn Engine> {
        &self.engine
    }

    /// Stops beginning jobs and waits at most `patience` for the running ones.
    pub async fn drain(&self, patience: Duration) {
        self.drain.cancel();
        let mut changes = self.watch_changes();
        let idle = async {
            loop {
                changes.borrow_and_update();
                if self.running_jobs().is_empty() || changes.changed().await.is_err() {
                    return;
                }
            }
        };
        if tokio::time::timeout(patience, idle).await.is_err() {
            tracing::info!("a job still runs; it is interrupted, and the next start continues it");
        }
    }

    /// Stops the workers, interrupts the running jobs and waits for them at most `grace`.
    pub async fn shut_down(&self, grace: Duration) {
        self.stop.cancel();
        for running in self.running_jobs() {
            running.control.cancel();
        }
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        let ended = async {
            for task in tasks {
                task.await.ok();
            }
        };
        if tokio::time::timeout(grace, ended).await.is_err() {
            tracing::warn!("a running job did not stop in time; the next start continues it");
        }
    }

    /// Token that is cancelled when the service stops; event streams end with it.
    #[must_use]
    pub fn stopping(&self) -> &CancellationToken {
        &self.stop
    }

    /// Whether the service accepts and begins no jobs any more.
    #[must_use]
    pub fn is_draining(&self) -> bool {
        self.drain.is_cancelled()
    }

    /// Whether a worker of this process claims no job because the bucket refuses it.
    #[must_use]
    pub fn is_refused(&self) -> bool {
        !self.refused.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    pub(super) fn set_refused(&self, worker: Worker, refused: bool) {
        let mut all = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|other| *other != worker);
        if refused {
            all.push(worker);
        }
    }

    pub(super) fn running_jobs(&self) -> Vec<Arc<Running>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Number of running jobs of a lane in this process.
    #[must_use]
    pub fn running_in(&self, lane: Lane) -> usize {
        self.running_jobs().iter().filter(|r| r.worker.lane == lane).count()
    }

    pub(super) fn running(&self, job: JobId) -> Option<Arc<Running>> {
        self.running_jobs().into_iter().find(|r| r.job == job)
    }

    pub(super) fn set_running(&self, running: Arc<Running>) {
        self.running.lock().unwrap_or_else(PoisonError::into_inner).push(running);
    }

    pub(super) fn unset_running(&self, running: &Arc<Running>) {
        // This process may have begun the same job again after its lease expired, so compare the attempt.
        self.running.lock().unwrap_or_else(PoisonError::into_inner).retain(|r| !Arc::ptr_eq(r, running));
    }

    pub(super) fn woken(&self, lane: Lane) -> &Notify {
        &self.wake[lane as usize]
    }

    pub(super) fn announce(&self) {
        self.changes.send_modify(|n| *n += 1);
    }

    /// A receiver that changes whenever an event was stored.
    #[must_use]
    pub fn watch_changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Runs the short computation of a request on the threads for requests.
    ///
    /// The computation is cancelled when the caller drops the future.
    ///
    /// # Errors
    /// The computation's, or [`FaultKind::Internal`] when it panics.
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

    /// Stores a new job, or returns the session's unfinished job with the same request.
    ///
    /// `answer` makes the answer that a repeated request gets from the job's status.
    ///
    /// # Errors
    /// [`FaultKind::QueueFull`], [`FaultKind::TenantQueueFull`], [`FaultKind::ShuttingDown`], or the store's.
    pub async fn accept(
        &self,
        order: Order,
        answer: &(dyn Fn(&JobStatus) -> Option<AnswerRecord> + Send + Sync),
    ) -> Result<JobStatus, Fault> {
        if self.is_draining() {
            return Err(Fault::new(FaultKind::ShuttingDown, "the service is stopping; try again later"));
        }
        let supersede = order.supersede;
        let job = record(order);
        let event = serde_json::json!({ "status": "cancelled", "superseded_by": job.id }).to_string();
        let running = self.running_in(job.kind.lane());
        let status = |job: &JobRecord, before: Option<u32>| JobStatus::waiting(job.clone(), before, running);
        // The state machine decides the state of a superseded job.
        let to = next(JobState::Accepted, JobEvent::Cancel).unwrap_or(JobState::Cancelled);
        let new = NewJob {
            job: &job,
            limits: self.settings.queue(),
            event: &status_event(JobState::Accepted, 0),
            supersede: supersede.then_some(Supersede { from: JobState::Accepted, to, event: ("end", event) }),
            answer: &|job, before| answer(&status(job, before)),
        };
        let before = match self.store.insert_job(&new).await? {
            Insertion::Stored { superseded, before } => {
                for (old, _) in superseded {
                    tracing::info!(job.id = %old, superseded_by = %job.id, "superseded by a newer job");
                }
                before
            }
            Insertion::Twin(twin, before) => return Ok(status(&twin, before)),
            Insertion::Full => {
                let detail =
                    format!("the queue is full with {} waiting jobs; try again later", self.settings.max_waiting);
                return Err(Fault::new(FaultKind::QueueFull, detail));
            }
            Insertion::TenantFull => {
                let detail = format!(
                    "{} of your jobs wait, the most allowed; try again later",
                    self.settings.max_waiting_tenant
                );
                return Err(Fault::new(FaultKind::TenantQueueFull, detail));
            }
        };
        tracing::info!(job.id = %job.id, job.kind = job.kind.as_str(), session.id = %job.session, "job accepted");
        self.announce();
        // All workers of the lane look for it, and one claims it.
        self.woken(job.kind.lane()).notify_waiters();
        Ok(status(&job, Some(before)))
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

    /// The row of a job that a request names in its body or query, if the job belongs to `tenant`.
    ///
    /// # Errors
    /// As [`Service::job`]; [`FaultKind::NotFound`] for another tenant's job.
    pub async fn job_of(&self, tenant: &TenantId, id: JobId) -> Result<JobRecord, Fault> {
        match self.store.owner(&id.to_string()).await? {
            Some(owner) if owner.tenant != *tenant => {
                Err(Fault::new(FaultKind::NotFound, format!("there is no job {id}")))
            }
            Some(owner) if owner.deleted => {
                Err(Fault::new(FaultKind::Gone, format!("job {id} was deleted with its session")))
            }
            _ => self.job(id).await,
        }
    }

    /// Cancels a job; once this returns, the job can only end as cancelled.
    ///
    /// A waiting job is cancelled at once, a running one within a Newton iteration.
    ///
    /// # Errors
    /// [`FaultKind::WrongState`] when it has ended; as [`Service::job`].
    pub async fn cancel(&self, id: JobId) -> Result<JobStatus, Fault> {
        // The job may start between the read and the change: then read it again.
        for look in 0.. {
            let job = self.job(id).await?;
            if job.state.has_ended() {
                let detail = format!("the job has ended already: it is {}", job.state);
                return Err(Fault::new(FaultKind::WrongState, detail).with("job_status", job.state.as_str()));
            }
            if let Some(running) = self.running(id) {
                if running.request_cancel() {
                    // Stored before the answer. False when the worker was faster: then the job has ended as cancelled.
                    self.store.request_cancel(id).await?;
                    return self.status(id).await;
                }
                // The end of the job is being written; read it again.
                tokio::time::sleep(Duration::from_millis(5)).await;
                continue;
            }
            if job.state == JobState::Running && look >= LOOKS && self.store.is_shared() {
                // Another process computes the job and sees the request when it renews the lease.
                self.store.request_cancel(id).await?;
                return self.status(id).await;
            }
            if job.state == JobState::Running && look < LOOKS {
                // The job was just claimed, and its worker is not in the list of running jobs yet.
                tokio::time::sleep(Duration::from_millis(5)).await;
                continue;
            }
            let change = JobChange { events: vec![end_event(JobState::Cancelled, None)], ..JobChange::default() };
            if let Ok(to) = next(job.state, JobEvent::Cancel)
                && self.store.change_job(&job, to, &change).await?
            {
                self.announce();
                return self.status(id).await;
            }
            tokio::task::yield_now().await;
        }
        self.status(id).await
    }

    /// Deletes a session so that it can be restored for a while ([`ServiceSettings::deleted_retention`]).
    ///
    /// Cancels the jobs in it and those that read it. Returns false when the session does not exist or was deleted before.
    ///
    /// # Errors
    /// The store's.
    pub async fn hide_session(&self, id: SessionId) -> Result<bool, Fault> {
        if self.settings.deleted_retention.is_zero() {
            return self.delete_session(id).await;
        }
        for state in [JobState::Accepted, JobState::Interrupted, JobState::Running] {
            let all = JobFilter { session: Some(id), state: Some(state), limit: u32::MAX, ..JobFilter::default() };
            for job in self.store.jobs(&all).await? {
                self.cancel_unless_ended(job.id).await?;
            }
        }
        for running in self.running_jobs().iter().filter(|r| r.reads(id)) {
            self.cancel_unless_ended(running.job).await?;
        }
        let hidden = self.store.hide_session(id).await?;
        self.announce();
        Ok(hidden)
    }

    async fn cancel_unless_ended(&self, id: JobId) -> Result<(), Fault> {
        match self.cancel(id).await {
            Err(fault) if ![FaultKind::WrongState, FaultKind::NotFound, FaultKind::Gone].contains(&fault.kind) => {
                Err(fault)
            }
            Ok(_) | Err(_) => Ok(()),
        }
    }

    /// Deletes a session with everything in it for good, and stops the jobs in it and those that read it.
    ///
    /// # Errors
    /// The store's.
    pub async fn delete_session(&self, id: SessionId) -> Result<bool, Fault> {
        for running in self.running_jobs().iter().filter(|r| r.reads(id)) {
            running.control.cancel();
        }
        let deleted = self.store.delete_session(id).await?;
        self.announce();
        Ok(deleted)
    }
}

/// Number of times that a cancellation waits 5 ms for a running job's worker to appear in this process.
const LOOKS: u32 = 50;

fn record(order: Order) -> JobRecord {
    JobRecord {
        steps: order.steps,
        subject: order.subject,
        other_session: order.other_session,
        max_wall_s: order.max_wall_s,
        traceparent: trace::traceparent(&tracing::Span::current()),
        ..JobRecord::accepted(order.kind, order.session, order.request)
    }
}

struct CancelOnDrop(Control);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

pub(super) fn panicked() -> Fault {
    Fault::new(FaultKind::Internal, "a computation panicked; see the log of the service")
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
