use serde_json::{Value, json};

use crate::http::problem::ProblemDocument;
use prosopon_contract::Fault;
use prosopon_store::{EventRecord, JobId};

/// Data of an event as sent: stored data, links to a step's results, and the problem of a failed job.
pub(in crate::http) fn render_event(job: JobId, event: &EventRecord) -> Value {
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
            if members.get("status").is_some_and(|s| s == "succeeded") {
                links["report"] = format!("{own}/report").into();
            }
            members.insert("links".to_owned(), links);
        }
        _ => {}
    }
    data
}
