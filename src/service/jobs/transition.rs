//! Changes of a job's state in the store.

use std::time::Duration;

use super::Service;
use super::events::{end_event, status_event};
use super::state::{JobEvent, next};
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::{JobChange, JobRecord, JobState, StoreError};

/// Time between two attempts after a failure of the store.
pub(super) const PAUSE: Duration = Duration::from_secs(2);

/// The recovery of an unfinished job; `None` for one that waits or has ended.
pub(super) fn recovery(job: &JobRecord, max_attempts: u32) -> Option<(JobEvent, JobChange)> {
    if job.cancel_requested_at.is_some() {
        return Some((JobEvent::Cancel, ended(JobState::Cancelled, None)));
    }
    let events = |state| vec![("status", status_event(state, job.attempt))];
    match job.state {
        JobState::Running => {
            let events = events(JobState::Interrupted);
            Some((JobEvent::Interrupt, JobChange { events, ..JobChange::default() }))
        }
        JobState::Interrupted if job.attempt < max_attempts => {
            let events = events(JobState::Accepted);
            Some((JobEvent::Requeue, JobChange { phase: Some("waiting"), events, ..JobChange::default() }))
        }
        JobState::Interrupted => {
            let detail = format!(
                "the process ended {} times while the job ran, so it is not tried again; the job may have caused this by lack of memory or by a fault",
                job.attempt
            );
            let fault = Fault::new(FaultKind::JobInterrupted, detail)
                .with("attempts", job.attempt)
                .with("job_status", JobState::Failed.as_str());
            Some((JobEvent::GiveUp, ended(JobState::Failed, Some(&fault))))
        }
        JobState::Accepted | JobState::Succeeded | JobState::Failed | JobState::Cancelled => None,
    }
}

pub(super) fn ended(state: JobState, fault: Option<&Fault>) -> JobChange {
    JobChange {
        fault: fault.and_then(|f| serde_json::to_string(f).ok()),
        events: vec![end_event(state, fault, None)],
        ..JobChange::default()
    }
}

/// Stores the end of a job and retries while the database takes no writes.
///
/// Without it the job would seem to run until the next start.
pub(super) async fn record_end(
    service: &Service,
    job: &JobRecord,
    event: JobEvent,
    change: &JobChange,
) -> Result<bool, Fault> {
    let to = next(job.state, event).map_err(|e| illegal(&e))?;
    loop {
        match write(service, job, to, change).await {
            Err(error)
                if (error.is_unreachable() || matches!(error, StoreError::Database(_) | StoreError::Io(_)))
                    && !service.stop.is_cancelled() =>
            {
                tracing::error!(%error, "the end of a job cannot be stored yet; trying again");
                pause(service).await;
            }
            written => return Ok(written?),
        }
    }
}

/// Changes the state of a job by `event`; false when the job is not in its state any more.
pub(super) async fn apply(
    service: &Service,
    job: &JobRecord,
    event: JobEvent,
    change: JobChange,
) -> Result<bool, Fault> {
    let to = next(job.state, event).map_err(|e| illegal(&e))?;
    Ok(write(service, job, to, &change).await?)
}

pub(super) async fn write(
    service: &Service,
    job: &JobRecord,
    to: JobState,
    change: &JobChange,
) -> Result<bool, StoreError> {
    let changed = match service.store.change_job(job, to, change).await {
        // The last large result exceeds the quota, so the job fails.
        Err(StoreError::QuotaFull { allowed }) => {
            let fault = Fault::from(StoreError::QuotaFull { allowed });
            let to = next(job.state, JobEvent::Fail).unwrap_or(JobState::Failed);
            service.store.change_job(job, to, &ended(JobState::Failed, Some(&fault))).await?
        }
        other => other?,
    };
    service.announce();
    Ok(changed)
}

pub(super) fn illegal(error: &super::state::Illegal) -> Fault {
    tracing::error!(%error, "illegal change of a job's state");
    Fault::new(FaultKind::Internal, error.to_string())
}

pub(super) async fn pause(service: &Service) {
    tokio::select! {
        () = tokio::time::sleep(PAUSE) => {}
        () = service.stop.cancelled() => {}
    }
}
