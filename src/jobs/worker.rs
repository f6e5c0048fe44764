use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tracing::Instrument;

use super::Service;
use super::running::Running;
use super::service::{end_event, panicked, status_event, warning_event};
use super::state::{JobEvent, next};
use super::work::{self, Done};
use crate::session::{Fault, FaultKind, Halt};
use crate::store::{JobChange, JobFilter, JobRecord, JobState, StoreError};

/// Shortest time between two progress events.
const PROGRESS_EVERY: Duration = Duration::from_millis(250);

/// Jobs that an earlier run left running become interrupted; interrupted ones are accepted again or given up.
pub(super) async fn recover(service: &Service) -> Result<(), Fault> {
    for state in [JobState::Running, JobState::Interrupted] {
        let filter = JobFilter { state: Some(state), limit: u32::MAX, ..JobFilter::default() };
        for job in service.store.jobs(&filter).await? {
            if state == JobState::Running {
                let events = vec![("status", status_event(JobState::Interrupted, job.attempt))];
                apply(service, &job, JobEvent::Interrupt, JobChange { events, ..JobChange::default() }).await?;
            } else if job.attempt < service.settings.max_attempts {
                tracing::info!(job.id = %job.id, attempt = job.attempt, "interrupted job is taken up again");
                let events = vec![("status", status_event(JobState::Accepted, job.attempt))];
                let change = JobChange { phase: Some("waiting"), events, ..JobChange::default() };
                apply(service, &job, JobEvent::Requeue, change).await?;
            } else {
                let detail = format!("the service stopped {} times while the job ran", job.attempt);
                let fault = Fault::new(FaultKind::JobInterrupted, detail).with("attempts", job.attempt);
                apply(service, &job, JobEvent::GiveUp, ended(JobState::Failed, Some(&fault))).await?;
            }
        }
    }
    Ok(())
}

/// Runs jobs one after the other until the service stops.
pub(super) async fn work_through(service: Arc<Service>) {
    loop {
        // Registered before the look, so that a job stored in between is not missed.
        let woken = service.wake.notified();
        if service.stop.is_cancelled() {
            return;
        }
        match service.store.next_job().await {
            Ok(Some(job)) => {
                let span = tracing::info_span!("job", job.id = %job.id, session.id = %job.session, job.kind = job.kind.as_str());
                if let Err(error) = run(&service, job).instrument(span).await {
                    tracing::error!(detail = error.detail, "a job could not be recorded");
                    pause(&service).await;
                }
            }
            Ok(None) => tokio::select! {
                () = woken => {}
                () = service.stop.cancelled() => {}
            },
            Err(error) => {
                tracing::error!(%error, "the queue cannot be read");
                pause(&service).await;
            }
        }
    }
}

async fn pause(service: &Service) {
    tokio::select! {
        () = tokio::time::sleep(Duration::from_secs(2)) => {}
        () = service.stop.cancelled() => {}
    }
}

async fn run(service: &Arc<Service>, mut job: JobRecord) -> Result<(), Fault> {
    let running = Arc::new(Running::new(job.id));
    // Visible before the row says so: a cancel finds either the waiting row or this.
    *service.running.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&running));
    let result = run_visible(service, &mut job, &running).await;
    *service.running.lock().unwrap_or_else(PoisonError::into_inner) = None;
    service.announce();
    result
}

async fn run_visible(service: &Arc<Service>, job: &mut JobRecord, running: &Arc<Running>) -> Result<(), Fault> {
    job.attempt += 1;
    let events = vec![("status", status_event(JobState::Running, job.attempt))];
    let start = JobChange { phase: Some("reading"), attempt_change: 1, events, ..JobChange::default() };
    if !apply(service, job, JobEvent::Start, start).await? {
        return Ok(());
    }
    job.state = JobState::Running;
    tracing::info!(attempt = job.attempt, "job started");

    // A task of its own, so that a panic in it ends the job and not the queue.
    let work = work::perform(Arc::clone(service), job.clone(), Arc::clone(running));
    let mut work = tokio::spawn(work.in_current_span());
    let done = tokio::select! {
        done = &mut work => done.unwrap_or_else(|_| Err(panicked().into())),
        () = tell_progress(service, job, running) => work.await.unwrap_or_else(|_| Err(panicked().into())),
    };

    let (event, change) = match done {
        Ok(Done { report, tissue, warnings: found }) => {
            let mut warnings = running.warnings();
            warnings.extend(found);
            let mut events: Vec<_> = warnings.iter().map(|w| warning_event(w)).collect();
            events.push(end_event(JobState::Succeeded, None));
            (
                JobEvent::Succeed,
                JobChange { phase: Some("done"), report, tissue, warnings, events, ..JobChange::default() },
            )
        }
        Err(Halt::Cancelled) if service.stop.is_cancelled() && !running.cancel_requested() => {
            // A stop in good order is no failed attempt.
            let events = vec![("status", status_event(JobState::Interrupted, job.attempt))];
            (JobEvent::Interrupt, JobChange { attempt_change: -1, events, ..JobChange::default() })
        }
        Err(Halt::Cancelled) => (JobEvent::Cancel, stopped(running, ended(JobState::Cancelled, None))),
        Err(Halt::Fault(fault)) => (JobEvent::Fail, stopped(running, ended(JobState::Failed, Some(&fault)))),
    };
    let seconds = running.started.elapsed().as_secs_f64();
    tracing::info!(outcome = ?event, duration_s = seconds, "job ended");
    metrics::counter!("prosopon_jobs_total", "kind" => job.kind.as_str(), "outcome" => format!("{event:?}").to_lowercase())
        .increment(1);
    metrics::histogram!("prosopon_job_seconds", "kind" => job.kind.as_str()).record(seconds);
    if !apply(service, job, event, change).await? && service.store.session(job.session).await?.is_none() {
        // The session was deleted while the job ran: nothing of it stays.
        service.store.blobs().delete_session(job.session).await?;
    }
    Ok(())
}

fn ended(state: JobState, fault: Option<&Fault>) -> JobChange {
    JobChange {
        fault: fault.and_then(|f| serde_json::to_string(f).ok()),
        events: vec![end_event(state, fault)],
        ..JobChange::default()
    }
}

/// Where the work stood: what the row says may be a quarter of a second old.
fn stopped(running: &Running, change: JobChange) -> JobChange {
    let warnings = running.warnings();
    let mut events: Vec<_> = warnings.iter().map(|w| warning_event(w)).collect();
    events.extend(change.events);
    let (phase, progress) = (Some(running.phase().as_str()), Some(running.control.progress()));
    JobChange { phase, progress, warnings, events, ..change }
}

/// Moves the job by `event`. False when it is not in its state any more.
async fn apply(service: &Service, job: &JobRecord, event: JobEvent, change: JobChange) -> Result<bool, Fault> {
    let to = next(job.state, event).map_err(|e| {
        tracing::error!(error = %e, "an illegal change of a job");
        Fault::new(FaultKind::Internal, e.to_string())
    })?;
    let changed = service.store.change_job(job.id, job.state, to, &change).await?;
    service.announce();
    Ok(changed)
}

/// Stores progress now and then; ends when the job is not running any more.
async fn tell_progress(service: &Service, job: &JobRecord, running: &Running) {
    let mut last = ("", -1.0);
    loop {
        tokio::time::sleep(PROGRESS_EVERY).await;
        let (phase, progress) = (running.phase().as_str(), running.control.progress());
        if phase == last.0 && progress - last.1 < 0.01 {
            continue;
        }
        last = (phase, progress);
        let event = serde_json::json!({ "phase": phase, "progress": progress, "eta_s": running.eta_s() });
        match service.store.record_progress(job.id, phase, progress, &event.to_string()).await {
            Ok(true) => service.announce(),
            Ok(false) | Err(StoreError::SessionGone) => return,
            Err(error) => tracing::warn!(%error, "progress could not be stored"),
        }
    }
}
