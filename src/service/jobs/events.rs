//! Events of jobs, and the fault of a computation that panicked.

use prosopon_contract::{Fault, FaultKind, SeverityName, WarningDocument};
use prosopon_store::{JobId, JobState};

pub(super) fn panicked() -> Fault {
    Fault::new(FaultKind::Internal, "a computation panicked; see the log of the service")
}

pub(super) fn status_event(state: JobState, attempt: u32) -> String {
    serde_json::json!({ "status": state.as_str(), "attempt": attempt }).to_string()
}

/// The event of a warning; notes have none.
pub(super) fn warning_event(warning: &WarningDocument) -> Option<(&'static str, String)> {
    (warning.severity > SeverityName::Info).then(|| ("warning", serde_json::json!(warning).to_string()))
}

/// The last event of a job; `next` is the job that continues it.
pub(super) fn end_event(state: JobState, fault: Option<&Fault>, next: Option<JobId>) -> (&'static str, String) {
    let mut event = serde_json::json!({ "status": state.as_str(), "fault": fault });
    if let (Some(next), Some(event)) = (next, event.as_object_mut()) {
        event.insert("continued_by".to_owned(), next.to_string().into());
    }
    ("end", event.to_string())
}
