use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use uuid::Uuid;

use crate::http::problem::ProblemDocument;
use prosopon_contract::{BudgetDocument, Fault, Findings, WarningDocument};
use prosopon_jobs::{JobStatus, phase_names};
use prosopon_store::{JobId, JobKind, JobRecord, JobState};

/// A job and its current state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// Id of the job.
    pub id: Uuid,
    /// Id of the session that the job belongs to.
    pub session: Uuid,
    /// Id of the plan that a solve follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<Uuid>,
    /// Kind of job.
    #[schema(schema_with = kinds)]
    pub kind: String,
    /// Status.
    #[schema(schema_with = statuses)]
    pub status: String,
    /// Phase of the work.
    #[schema(schema_with = phases)]
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
    /// What `auto` chose for the `budget` of a solve, before the solve; the report's `budget` has what it took.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetDocument>,
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
    /// Paths of the job and of its results so far.
    pub links: JobLinks,
}

impl JobView {
    /// The view of a stored record, without queue position and steps.
    pub(in crate::http) fn new(record: &JobRecord) -> Self {
        let fault: Option<Fault> = record.fault.as_deref().and_then(|f| serde_json::from_str(f).ok());
        Self {
            id: record.id.uuid(),
            session: record.session.uuid(),
            plan: record.subject.as_deref().filter(|_| record.kind == JobKind::Solve).and_then(|id| id.parse().ok()),
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
            budget: budget(record),
            continues: record.continues.map(JobId::uuid),
            continued_by: record.continued_by.map(JobId::uuid),
            residuals: Vec::new(),
            findings: findings(&record.warnings),
            problem: fault.as_ref().map(ProblemDocument::from),
            created_at: record.created_at.clone(),
            started_at: record.started_at.clone(),
            finished_at: record.finished_at.clone(),
            links: JobLinks::new(record, 0),
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
            links: JobLinks::new(&status.record, status.steps_done),
            ..Self::new(&status.record)
        }
    }
}

/// The stored warnings of a row.
fn findings(stored: &[String]) -> Findings {
    stored.iter().map(|text| WarningDocument::from_row(text)).collect()
}

/// The budget of a solve as it was chosen.
fn budget(record: &JobRecord) -> Option<BudgetDocument> {
    #[derive(Deserialize)]
    struct Chosen {
        budget: Option<BudgetDocument>,
    }
    let solve = (record.kind == JobKind::Solve).then(|| serde_json::from_str::<Chosen>(&record.request).ok());
    solve.flatten().and_then(|chosen| chosen.budget)
}

/// Paths of a job's results so far.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobLinks {
    /// The job.
    #[serde(rename = "self")]
    pub own: String,
    /// Its events.
    pub events: String,
    /// Where a POST cancels it; absent once it has ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cancel: Option<String>,
    /// Skin of an import.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skin: Option<String>,
    /// Skull of an import.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skull: Option<String>,
    /// Distance fields.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// Tissue mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// Result of a comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub comparison: Option<String>,
    /// Triangles of a solve's skin, from its first step on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub topology: Option<String>,
    /// Skin of the last finished step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_skin: Option<String>,
    /// Report of a solve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
    /// Deformed volume of a solve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tissue: Option<String>,
}

impl JobLinks {
    fn new(record: &JobRecord, steps_done: u32) -> Self {
        let own = format!("/v1/jobs/{}", record.id);
        let session = format!("/v1/sessions/{}", record.session);
        let has_succeeded = record.state == JobState::Succeeded;
        let once = |known: bool, path: String| known.then_some(path);
        let of_kind = |kind: JobKind, path: String| once(has_succeeded && record.kind == kind, path);
        let has_steps = record.kind == JobKind::Solve && steps_done > 0;
        let has_volume = record.tissue_blob.is_some();
        Self {
            events: format!("{own}/events"),
            cancel: once(!record.state.has_ended(), format!("{own}/cancel")),
            skin: of_kind(JobKind::Import, format!("{session}/skin")),
            skull: of_kind(JobKind::Import, format!("{session}/skull")),
            field: of_kind(JobKind::Field, format!("{session}/field")),
            mesh: of_kind(JobKind::Mesh, format!("{session}/mesh")),
            comparison: of_kind(JobKind::Compare, format!("{own}/comparison")).filter(|_| record.rest_blob.is_some()),
            topology: once(has_steps, format!("{own}/topology")),
            last_skin: once(has_steps, format!("{own}/steps/{steps_done}/skin")),
            report: of_kind(JobKind::Solve, format!("{own}/report")),
            tissue: of_kind(JobKind::Solve, format!("{own}/tissue")).filter(|_| has_volume),
            own,
        }
    }
}

fn kinds() -> Schema {
    names(JobKind::ALL.map(JobKind::as_str), "Kind of job.")
}

pub(in crate::http) fn statuses() -> Schema {
    let description = "Status.\n\n`interrupted` means that the service stopped while the job ran. The job runs again, or fails \
        with the problem `job-interrupted` when its attempts are used up.";
    names(JobState::ALL.map(JobState::as_str), description)
}

pub(super) fn phases() -> Schema {
    names(phase_names(), "Phase of the work. A failed or cancelled job keeps the phase in which it ended.")
}

/// The schema of a text that is one of these names.
fn names(names: impl IntoIterator<Item = &'static str>, description: &str) -> Schema {
    let text = ObjectBuilder::new().schema_type(Type::String);
    text.enum_values(Some(names)).description(Some(description)).into()
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
