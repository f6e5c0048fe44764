//! Jobs from their acceptance to their cancellation, and the deletion of sessions.

use std::time::Duration;

use super::events::{end_event, status_event};
use super::state::{JobEvent, next};
use super::{JobStatus, Order, Service};
use crate::trace;
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::{
    AnswerRecord, Insertion, JobChange, JobFilter, JobId, JobRecord, JobState, NewJob, SessionId, Supersede, TenantId,
};

/// Number of times that a cancellation waits 5 ms for a running job's worker to appear in this process.
const LOOKS: u32 = 50;

/// Why an ended job cannot be cancelled; names the job that goes on in its place.
fn has_ended(job: &JobRecord) -> Fault {
    let ended = format!("the job has ended already: it is {}", job.state);
    let fault = |detail| Fault::new(FaultKind::WrongState, detail).with("job_status", job.state.as_str());
    match job.continued_by {
        Some(next) => fault(format!("{ended}; job {next} goes on with a better setting: cancel that one"))
            .with("continued_by", next.to_string()),
        None => fault(ended),
    }
}

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

impl Service {
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
            supersede: supersede.map(|scope| Supersede { scope, from: JobState::Accepted, to, event: ("end", event) }),
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
    /// A waiting job is cancelled at once, a running one within a second; its computation can take longer to stop.
    ///
    /// # Errors
    /// [`FaultKind::WrongState`] when it has ended; as [`Service::job`].
    pub async fn cancel(&self, id: JobId) -> Result<JobStatus, Fault> {
        // The job may start between the read and the change: then read it again.
        for look in 0.. {
            let job = self.job(id).await?;
            if job.state.has_ended() {
                return Err(has_ended(&job));
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
            let change = JobChange { events: vec![end_event(JobState::Cancelled, None, None)], ..JobChange::default() };
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

    /// Deletes a session so that it can be restored for a while ([`deleted_retention`](super::ServiceSettings::deleted_retention)).
    ///
    /// Cancels the jobs in it and those that read it. Returns false when the session does not exist or was deleted before.
    ///
    /// # Errors
    /// The store's.
    pub async fn hide_session(&self, id: SessionId) -> Result<bool, Fault> {
        self.take_away(id, false).await
    }

    /// Same as [`Service::hide_session`] for a session whose retention has ended.
    pub(super) async fn expire_session(&self, id: SessionId) -> Result<bool, Fault> {
        self.take_away(id, true).await
    }

    async fn take_away(&self, id: SessionId, expired: bool) -> Result<bool, Fault> {
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
        let hidden = if expired { self.store.expire_session(id).await? } else { self.store.hide_session(id).await? };
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
