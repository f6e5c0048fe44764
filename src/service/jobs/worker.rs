use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use tracing::field::Empty;
use tracing::{Instrument, Span};

use super::Service;
use super::events::{end_event, panicked, status_event, warning_event};
use super::lease::keep_lease;
use super::running::{Running, Worker};
use super::state::{JobEvent, next};
use super::transition::{PAUSE, ended, illegal, pause, record_end, recovery, write};
use super::work::{self, Done};
use crate::trace;
use prosopon_contract::{Fault, FaultKind, Halt, WarningDocument, chain, to_json};
use prosopon_store::{Claim, JobChange, JobRecord, JobState, Lane, StoreError};

/// Shortest time between two progress events.
const PROGRESS_EVERY: Duration = Duration::from_millis(250);

/// Longest time between two looks at the queue.
const LOOK_EVERY: Duration = Duration::from_secs(5);
/// The same in a shared store: after it the job left to another worker may be claimed.
const LOOK_AGAIN: Duration = Claim::HEAD_START.saturating_add(Duration::from_millis(50));

/// A bucket that takes longer for one small blob counts as unreachable.
const BUCKET_ANSWERS: Duration = Duration::from_secs(10);

/// Runs the jobs of the worker's lane one after the other until the service stops.
pub(super) async fn work_through(service: Arc<Service>, worker: Worker) {
    let lane = worker.lane;
    let look_every = if service.store.is_shared() { LOOK_AGAIN } else { LOOK_EVERY };
    loop {
        // Registered before the claim, so that a job stored in between is not missed.
        let woken = service.woken(lane).notified();
        service.beats.beat(worker);
        if service.stop.is_cancelled() {
            return;
        }
        match claim(&service, lane).await {
            Ok(Some(job)) => {
                let span = tracing::info_span!(
                    "job", job.id = %job.id, session.id = %job.session, tenant = %job.tenant, job.kind = job.kind.as_str(),
                    otel.kind = "consumer", otel.status_code = Empty
                );
                if let Some(parent) = &job.traceparent {
                    trace::continue_from(&span, parent);
                }
                match run(&service, job, worker).instrument(span).await {
                    Ok(Ran::ToItsEnd) => {}
                    Ok(Ran::UntilTheStoreFailed) => {
                        // A pause, so that a failure of this job alone is not repeated without end.
                        pause(&service).await;
                        wait_for_store(&service, worker).await;
                    }
                    Err(error) => {
                        tracing::error!(detail = error.detail, "a job could not be recorded");
                        pause(&service).await;
                    }
                }
            }
            Ok(None) => tokio::select! {
                () = woken => {}
                () = tokio::time::sleep(look_every) => {}
                () = service.stop.cancelled() => {}
            },
            Err(error) => {
                tracing::error!(detail = error.detail, "the queue cannot be read");
                pause(&service).await;
            }
        }
    }
}

/// Claims the next job.
async fn claim(service: &Service, lane: Lane) -> Result<Option<JobRecord>, Fault> {
    if service.is_draining() {
        return Ok(None);
    }
    // A job that starts now would fail at its first result; it waits for room instead.
    if let Err(full) = service.store.check_room() {
        tracing::warn!(error = chain(&full), "no job is started");
        return Ok(None);
    }
    let to = next(JobState::Accepted, JobEvent::Start).map_err(|e| illegal(&e))?;
    let start = |job: &JobRecord| JobChange {
        phase: Some("reading"),
        attempt_change: 1,
        events: vec![("status", status_event(JobState::Running, job.attempt + 1))],
        ..JobChange::default()
    };
    let worker = service.store.is_shared().then_some(service.worker);
    let claim = Claim { lane, worker, patience: Claim::PATIENCE, to, lease: service.settings.lease };
    Ok(service.store.claim_job(&claim, &start).await?)
}

/// How an attempt ended.
enum Ran {
    ToItsEnd,
    /// The job waits again for any worker.
    UntilTheStoreFailed,
}

/// Waits until blobs can be read and written.
///
/// Otherwise a worker that the bucket refuses would claim job after job from workers that it serves.
async fn wait_for_store(service: &Service, worker: Worker) {
    while !service.stop.is_cancelled() {
        let answer = tokio::select! {
            // For a bucket that cannot be reached, this takes the minute of its retries.
            answer = beating(service, worker, service.store.check_writing()) => answer,
            () = service.stop.cancelled() => return,
        };
        service.set_refused(worker, matches!(answer, Err(StoreError::BucketDenied(_))));
        let Err(error) = answer else { return };
        tracing::error!(error = chain(&error), "this worker claims no job until the bucket can be used");
        pause(service).await;
    }
}

/// Whether the bucket takes other requests of this process; false when it cannot be reached.
async fn refuses_no_others(service: &Service) -> bool {
    let asked = tokio::time::timeout(BUCKET_ANSWERS, service.store.check_writing());
    matches!(asked.await, Ok(Ok(())))
}

/// Waits for the store and sends the worker's heartbeat meanwhile.
async fn beating<T>(service: &Service, worker: Worker, work: impl Future<Output = T>) -> T {
    let mut work = pin!(work);
    loop {
        service.beats.beat(worker);
        if let Ok(done) = tokio::time::timeout(PAUSE, &mut work).await {
            return done;
        }
    }
}

async fn run(service: &Arc<Service>, job: JobRecord, worker: Worker) -> Result<Ran, Fault> {
    let running =
        Arc::new(Running::new(&job, worker, service.settings.max_wall, service.settings.memory_of_a_job_mb()));
    service.set_running(Arc::clone(&running));
    // A stop between the claim and this point did not find the job.
    if service.stop.is_cancelled() {
        running.control.cancel();
    }
    let result = run_visible(service, &job, &running).await;
    service.unset_running(&running);
    service.announce();
    result
}

async fn run_visible(service: &Arc<Service>, job: &JobRecord, running: &Arc<Running>) -> Result<Ran, Fault> {
    service.announce();
    tracing::info!(attempt = job.attempt, "job started");

    // A separate task, so that a panic in it ends the job and not the worker.
    let work = work::perform(Arc::clone(service), job.clone(), Arc::clone(running));
    let mut work = tokio::spawn(work.in_current_span());
    let ends = async {
        let done = (&mut work).await.unwrap_or_else(|_| Err(panicked().into()));
        let refused = matches!(&done, Err(Halt::Fault(fault)) if fault.kind == FaultKind::StoreRefuses);
        let only_this = refused && refuses_no_others(service).await;
        (done, only_this)
    };
    let ended = tokio::select! {
        ended = ends => Some(ended),
        () = running.ignores_stop() => None,
        never = report_progress(service, job, running) => match never {},
        never = keep_lease(service, job, running) => match never {},
    };
    let computes_on = ended.is_none();
    let (done, only_this) = ended.unwrap_or((Err(Halt::Cancelled), false));
    let (event, change) = outcome(service, job, running, done, only_this);
    record_metrics(job, running, event);
    let ran = beating(service, running.worker, end(service, job, event, &change)).await;
    if computes_on {
        // A factorisation sees a stop late. The job has ended for everybody else; its worker waits for the processors.
        running.computes_on();
        service.announce();
        tokio::select! {
            _ = beating(service, running.worker, work) => {}
            // The process ends, and the computation with it.
            () = service.stop.cancelled() => {}
        }
        remove_if_deleted(service, job).await?;
    }
    ran
}

/// Stores the end of an attempt; an interrupted job is accepted again.
async fn end(service: &Service, job: &JobRecord, event: JobEvent, change: &JobChange) -> Result<Ran, Fault> {
    if !record_end(service, job, event, change).await? {
        remove_if_deleted(service, job).await?;
    }
    if event == JobEvent::Interrupt && !service.stop.is_cancelled() {
        requeue(service, job).await?;
        return Ok(Ran::UntilTheStoreFailed);
    }
    Ok(Ran::ToItsEnd)
}

/// Removes what the job stored if its session was deleted while it ran.
async fn remove_if_deleted(service: &Service, job: &JobRecord) -> Result<(), Fault> {
    if service.store.session(job.session).await?.is_none() {
        service.store.blobs().delete_session(job.session).await;
    }
    Ok(())
}

/// The change of state at the end of an attempt.
///
/// `only_this` means that the bucket refuses this job's requests only.
fn outcome(
    service: &Service,
    job: &JobRecord,
    running: &Running,
    done: Result<Done, Halt>,
    only_this: bool,
) -> (JobEvent, JobChange) {
    // From here on a cancellation comes too late.
    if !running.close() {
        return (JobEvent::Cancel, stopped(running, ended(JobState::Cancelled, None)));
    }
    match done {
        Ok(Done { report, tissue, warnings: found, continuation }) => {
            // Warnings of steps have their events already.
            let mut events: Vec<_> = running.own_warnings().iter().chain(&found).filter_map(warning_event).collect();
            let warnings = stored_warnings(running.warnings().iter().chain(&found));
            let next = continuation.as_ref().map(|next| next.0.id);
            events.push(end_event(JobState::Succeeded, None, next));
            let phase = Some("done");
            let change = JobChange { phase, report, tissue, warnings, events, continuation, ..JobChange::default() };
            (JobEvent::Succeed, change)
        }
        Err(Halt::Fault(fault)) if fault.kind == FaultKind::StoreUnavailable => interrupted(job, -1),
        Err(Halt::Fault(fault)) if fault.kind == FaultKind::StoreRefuses && !only_this => interrupted(job, -1),
        // What is kept free was reached: the job goes on from its last step once there is room.
        Err(Halt::Fault(fault)) if fault.kind == FaultKind::StorageFull && service.store.check_room().is_err() => {
            interrupted(job, -1)
        }
        Err(Halt::Fault(_)) if only_this && job.attempt < service.settings.max_attempts => interrupted(job, 0),
        Err(Halt::Fault(fault)) => (JobEvent::Fail, stopped(running, ended(JobState::Failed, Some(&fault)))),
        Err(Halt::Cancelled) if service.stop.is_cancelled() && !running.control.is_overdue() => interrupted(job, -1),
        Err(Halt::Cancelled) if running.control.is_overdue() => {
            let seconds = running.started.elapsed().as_secs_f64();
            let detail = format!("the job was stopped after {seconds:.0} s, the most that it may compute");
            let fault = Fault::new(FaultKind::DeadlineExceeded, detail);
            (JobEvent::Fail, stopped(running, ended(JobState::Failed, Some(&fault))))
        }
        // The session of the job is being deleted.
        Err(Halt::Cancelled) => (JobEvent::Cancel, stopped(running, ended(JobState::Cancelled, None))),
    }
}

/// The change for work that was stopped from outside.
///
/// A stop of the service or a failed store takes the attempt back (-1).
fn interrupted(job: &JobRecord, attempt_change: i64) -> (JobEvent, JobChange) {
    let events = vec![("status", status_event(JobState::Interrupted, job.attempt))];
    (JobEvent::Interrupt, JobChange { attempt_change, events, ..JobChange::default() })
}

/// Accepts a job again that was interrupted while the service continues.
async fn requeue(service: &Service, job: &JobRecord) -> Result<(), Fault> {
    let row = service.persist(|| service.store.job(job.id)).await?;
    let Some(job) = row.filter(|row| row.state == JobState::Interrupted) else { return Ok(()) };
    let Some((event, change)) = recovery(&job, service.settings.max_attempts) else { return Ok(()) };
    let to = next(job.state, event).map_err(|e| illegal(&e))?;
    service.persist(|| write(service, &job, to, &change)).await?;
    for lane in Lane::ALL {
        service.woken(lane).notify_waiters();
    }
    Ok(())
}

fn record_metrics(job: &JobRecord, running: &Running, event: JobEvent) {
    let (kind, outcome) = (job.kind.as_str(), format!("{event:?}").to_lowercase());
    let seconds = running.started.elapsed().as_secs_f64();
    tracing::info!(outcome, duration_s = seconds, "job ended");
    if event == JobEvent::Fail {
        Span::current().record("otel.status_code", "ERROR");
    }
    metrics::counter!("prosopon_jobs_total", "kind" => kind, "outcome" => outcome).increment(1);
    metrics::histogram!("prosopon_job_seconds", "kind" => kind).record(seconds);
    let model = model_of(job);
    for (stage, seconds) in running.stage_seconds() {
        let labels = [("kind", kind.to_owned()), ("stage", stage.to_owned()), ("model", model.clone())];
        metrics::histogram!("prosopon_job_stage_seconds", &labels).record(seconds);
    }
}

/// Mechanical model that a job requests; empty for jobs without one.
fn model_of(job: &JobRecord) -> String {
    let request: serde_json::Value = serde_json::from_str(&job.request).unwrap_or_default();
    let model = request.get("request").and_then(|request| request.get("model"));
    model.and_then(serde_json::Value::as_str).unwrap_or_default().to_owned()
}

/// Warnings in the form of a row; the codec cannot fail on them.
fn stored_warnings<'a>(warnings: impl IntoIterator<Item = &'a WarningDocument>) -> Vec<String> {
    warnings.into_iter().filter_map(|w| to_json("a warning", w).ok()).collect()
}

/// Adds the current stage, progress and warnings, because those in the row may be 250 ms old.
fn stopped(running: &Running, change: JobChange) -> JobChange {
    let warnings = stored_warnings(&running.warnings());
    let mut events: Vec<_> = running.own_warnings().iter().filter_map(warning_event).collect();
    events.extend(change.events);
    let (phase, progress) = (Some(running.phase().as_str()), Some(running.control.progress()));
    JobChange { phase, progress, warnings, events, ..change }
}

/// Stores the progress at intervals and sends the worker's heartbeat.
async fn report_progress(service: &Service, job: &JobRecord, running: &Running) -> std::convert::Infallible {
    let mut last = ("", -1.0);
    loop {
        tokio::time::sleep(PROGRESS_EVERY).await;
        service.beats.beat(running.worker);
        let (phase, progress, eta_s) = (running.phase().as_str(), running.control.progress(), running.eta_s());
        if phase == last.0 && progress - last.1 < 0.01 {
            continue;
        }
        last = (phase, progress);
        let event = serde_json::json!({ "phase": phase, "progress": progress, "eta_s": eta_s });
        match service.store.record_progress(job, phase, progress, &event.to_string()).await {
            Ok(true) => service.announce(),
            // The job was deleted. The work sees that at its next write; until then the heartbeat shows that the worker is alive.
            Ok(false) | Err(StoreError::SessionGone) => {}
            Err(error) => tracing::warn!(%error, "progress could not be stored"),
        }
    }
}
