use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::http::problem::ProblemDocument;
use prosopon_contract::{Fault, Findings, WarningDocument};
use prosopon_jobs::JobStatus;
use prosopon_store::{JobId, JobKind, JobRecord, JobState};

/// A job and its current state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// Id of the job.
    pub id: Uuid,
    /// Id of the session that the job belongs to.
    pub session: Uuid,
    /// Kind of job: `import`, `field`, `mesh`, `solve` or `compare`.
    pub kind: String,
    /// Status: `accepted`, `running`, `succeeded`, `failed`, `cancelled` or `interrupted`.
    ///
    /// `interrupted` means that the service stopped while the job ran. The job runs again, or fails with the problem
    /// `job-interrupted` when its attempts are used up.
    pub status: String,
    /// Phase of the work.
    ///
    /// One of `waiting`, `reading`, `surfaces`, `field`, `cut`, `mesh`, `solve`, `compare`, `writing` and `done`. A failed or
    /// cancelled job keeps the phase in which it ended.
    pub phase: String,
    /// Completed share of the work, 0 to 1.
    pub progress: f64,
    /// Number of finished steps.
    pub step: u32,
    /// Total number of steps; 0 for a job without steps.
    pub steps: u32,
    /// Estimated remaining time, s; `null` unless the job runs.
    pub eta_s: Option<f64>,
    /// Number of jobs ahead in the queue; `null` unless the job waits.
    pub queue_position: Option<u32>,
    /// How often the job was started.
    pub attempt: u32,
    /// When cancellation was requested (RFC 3339).
    ///
    /// From then on the job ends as `cancelled`, even if the service is killed before it stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cancel_requested_at: Option<String>,
    /// Id of the newer job that replaced this one in the queue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superseded_by: Option<Uuid>,
    /// Id of the job that missed the error of its `budget` and that this one continues with a better setting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub continues: Option<Uuid>,
    /// Id of the job that continues this one with a better setting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub continued_by: Option<Uuid>,
    /// Residual force of each finished step, in step order, relative to the reaction force.
    pub residuals: Vec<f64>,
    /// Warnings and notes about the inputs and the result.
    #[serde(flatten)]
    pub findings: Findings,
    /// Problem that made the job fail; `null` unless it failed.
    pub problem: Option<ProblemDocument>,
    /// When the job was accepted (RFC 3339).
    pub created_at: String,
    /// When the last attempt started (RFC 3339).
    pub started_at: Option<String>,
    /// When the job ended (RFC 3339).
    pub finished_at: Option<String>,
    /// Paths by name: `self`, `events`, `cancel` until the job ends, and the results so far.
    pub links: BTreeMap<String, String>,
}

impl JobView {
    /// The view of a stored record, without queue position and steps.
    pub(in crate::http) fn new(record: &JobRecord) -> Self {
        let fault: Option<Fault> = record.fault.as_deref().and_then(|f| serde_json::from_str(f).ok());
        Self {
            id: record.id.uuid(),
            session: record.session.uuid(),
            kind: record.kind.as_str().to_owned(),
            status: record.state.as_str().to_owned(),
            phase: record.phase.clone(),
            progress: record.progress,
            step: 0,
            steps: record.steps,
            eta_s: None,
            queue_position: None,
            attempt: record.attempt,
            cancel_requested_at: record.cancel_requested_at.clone(),
            superseded_by: record.superseded_by.map(JobId::uuid),
            continues: record.continues.map(JobId::uuid),
            continued_by: record.continued_by.map(JobId::uuid),
            residuals: Vec::new(),
            findings: findings(&record.warnings),
            problem: fault.as_ref().map(ProblemDocument::from),
            created_at: record.created_at.clone(),
            started_at: record.started_at.clone(),
            finished_at: record.finished_at.clone(),
            links: links(record, 0),
        }
    }
}

impl From<&JobStatus> for JobView {
    fn from(status: &JobStatus) -> Self {
        Self {
            step: status.steps_done,
            eta_s: status.eta_s,
            queue_position: status.queue_position,
            residuals: status.residuals.clone(),
            findings: status.findings.clone(),
            links: links(&status.record, status.steps_done),
            ..Self::new(&status.record)
        }
    }
}

/// The stored warnings of a row.
fn findings(stored: &[String]) -> Findings {
    stored.iter().map(|text| WarningDocument::from_row(text)).collect()
}

fn links(record: &JobRecord, steps_done: u32) -> BTreeMap<String, String> {
    let own = format!("/v1/jobs/{}", record.id);
    let mut links = BTreeMap::from([("self".to_owned(), own.clone())]);
    let mut add = |name: &str, path: String| links.insert(name.to_owned(), path);
    add("events", format!("{own}/events"));
    if !record.state.has_ended() {
        add("cancel", format!("{own}/cancel"));
    }
    let session = format!("/v1/sessions/{}", record.session);
    match (record.kind, record.state) {
        (JobKind::Import, JobState::Succeeded) => {
            add("skin", format!("{session}/skin"));
            add("skull", format!("{session}/skull"));
        }
        (JobKind::Field, JobState::Succeeded) => _ = add("field", format!("{session}/field")),
        (JobKind::Compare, JobState::Succeeded) if record.rest_blob.is_some() => {
            _ = add("comparison", format!("{own}/comparison"))
        }
        (JobKind::Mesh, JobState::Succeeded) => _ = add("mesh", format!("{session}/mesh")),
        (JobKind::Solve, state) => {
            if steps_done > 0 {
                add("topology", format!("{own}/topology"));
                add("last_skin", format!("{own}/steps/{steps_done}/skin"));
            }
            if state == JobState::Succeeded {
                add("report", format!("{own}/report"));
                if record.tissue_blob.is_some() {
                    add("tissue", format!("{own}/tissue"));
                }
            }
        }
        _ => {}
    }
    links
}

/// A page of jobs, newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobList {
    /// The jobs of this page.
    pub jobs: Vec<JobView>,
    /// Path of the next page; absent on the last page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}
