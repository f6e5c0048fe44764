use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::openapi::schema::{ObjectBuilder, Schema, SchemaFormat, Type};
use utoipa::openapi::{KnownFormat, RefOr};
use utoipa::{PartialSchema, ToSchema};
use uuid::Uuid;

use super::job::{phases, statuses};
use crate::http::problem::ProblemDocument;
use prosopon_contract::{Fault, StepDocument, WarningDocument};
use prosopon_store::{EventRecord, JobId};

const INT64: SchemaFormat = SchemaFormat::KnownFormat(KnownFormat::Int64);

/// A line of a stream of events.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobEventLine {
    /// Number of the event; a heartbeat has that of the last one.
    pub id: u64,
    /// The event.
    #[serde(flatten)]
    pub event: JobEvent,
}

impl PartialSchema for JobEventLine {
    /// Each variant of [`JobEvent`] with the number: some generators cannot join an object to variants.
    fn schema() -> RefOr<Schema> {
        let mut all = JobEvent::schema();
        if let RefOr::T(Schema::OneOf(events)) = &mut all {
            events.description = Some("A line of a stream of events.".to_owned());
            for event in &mut events.items {
                if let RefOr::T(Schema::Object(event)) = event {
                    let number = ObjectBuilder::new().schema_type(Type::Integer).format(Some(INT64)).minimum(Some(0));
                    let number = number.description(Some("Number of the event; a heartbeat has that of the last one."));
                    event.properties.insert("id".to_owned(), number.into());
                    event.required.push("id".to_owned());
                }
            }
        }
        all
    }
}

impl ToSchema for JobEventLine {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        JobEvent::schemas(schemas);
    }
}

/// A Server-Sent Event with its fields.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SentEvent {
    /// Number of the event.
    pub id: String,
    /// Name, as of the lines.
    pub event: String,
    /// The data of the line of this name, JSON.
    pub data: String,
}

/// An event of a job; a Server-Sent Event has its name and data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", content = "data", rename_all = "snake_case")]
pub enum JobEvent {
    /// The status has changed.
    Status(StatusEvent),
    /// The work has advanced.
    Progress(ProgressEvent),
    /// A step of a solve is stored.
    Step(Box<StepEvent>),
    /// A warning was found.
    Warning(WarningDocument),
    /// Earlier events are no longer stored: read the job.
    Resync(ResyncEvent),
    /// The job has ended.
    End(Box<EndEvent>),
    /// Nothing has happened for a while.
    Heartbeat(NoData),
}

/// A new status.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StatusEvent {
    /// Status.
    #[schema(schema_with = statuses)]
    pub status: String,
    /// How often the job was started.
    pub attempt: u32,
}

/// Phase and progress of the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProgressEvent {
    /// Phase.
    #[schema(schema_with = phases)]
    pub phase: String,
    /// Completed share of the work, 0 to 1.
    pub progress: f64,
    /// Estimated remaining time, s.
    pub eta_s: Option<f64>,
}

/// A finished step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StepEvent {
    /// The step.
    #[serde(flatten)]
    pub step: StepDocument,
    /// Number of all steps.
    pub steps: u32,
    /// Paths of its results.
    pub links: StepLinks,
}

/// Paths of a step's results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StepLinks {
    /// Skin.
    pub skin: String,
    /// The same as a frame.
    pub frame: String,
    /// Error map, where the step has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// Where to continue after lost events.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ResyncEvent {
    /// Status.
    #[schema(schema_with = statuses)]
    pub status: String,
    /// How often the job was started.
    pub attempt: u32,
    /// Path of the job.
    pub links: EndLinks,
}

/// The end of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EndEvent {
    /// Status.
    #[schema(schema_with = statuses)]
    pub status: String,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub problem: Option<ProblemDocument>,
    /// Id of the newer job that replaced it in the queue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superseded_by: Option<Uuid>,
    /// Id of the job that continues it with a better setting.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub continued_by: Option<Uuid>,
    /// Paths of the job and of its report.
    pub links: EndLinks,
}

/// Paths of a job and of its report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct EndLinks {
    /// The job.
    #[serde(rename = "self")]
    pub own: String,
    /// Its report, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<String>,
}

/// No member.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct NoData {}

/// Data of an event as sent: stored data, links to a step's results, and the problem of a failed job.
///
/// `has_report` says whether the job is of a kind with a report.
pub(in crate::http) fn render_event(job: JobId, has_report: bool, event: &EventRecord) -> Value {
    let mut data: Value = serde_json::from_str(&event.data).unwrap_or_default();
    let Some(members) = data.as_object_mut() else { return data };
    let own = format!("/v1/jobs/{job}");
    match event.kind.as_str() {
        "step" => {
            let step = format!("{own}/steps/{}", members.get("k").cloned().unwrap_or_default());
            let mut links = json!({ "skin": format!("{step}/skin"), "frame": format!("{step}/frame") });
            if members.remove("has_error") == Some(Value::Bool(true)) {
                links["error"] = format!("{step}/error").into();
            }
            members.insert("links".to_owned(), links);
        }
        "resync" => _ = members.insert("links".to_owned(), json!({ "self": own })),
        "end" => {
            let fault = members.remove("fault").and_then(|f| serde_json::from_value::<Fault>(f).ok());
            if let Some(fault) = fault {
                let problem = serde_json::to_value(ProblemDocument::from(&fault)).unwrap_or_default();
                members.insert("problem".to_owned(), problem);
            }
            let mut links = json!({ "self": own });
            if has_report && members.get("status").is_some_and(|s| s == "succeeded") {
                links["report"] = format!("{own}/report").into();
            }
            members.insert("links".to_owned(), links);
        }
        _ => {}
    }
    data
}
