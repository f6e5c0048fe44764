//! Examples of bodies: the requests of `api/examples`, which the tests send to the service, and the answers of a real run, which
//! `api/examples/record.py` writes.

use include_dir::{Dir, include_dir};
use serde_json::Value;
use utoipa::openapi::RefOr;
use utoipa::openapi::example::ExampleBuilder;
use utoipa::openapi::path::Operation;

static EXAMPLES: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/../../api/examples");

/// Stands for the ids in examples.
const ID: &str = "0197a2c0-0000-7000-8000-000000000001";
const PLACES: [&str; 3] = ["{session}", "{osteotomy}", "{plan}"];
/// A preview takes the requests of what it previews.
const PREVIEW: &str = "/preview";

/// Adds the examples of a JSON body.
pub(super) fn add_examples(method: &str, path: &str, operation: &mut Operation) {
    let Some(RefOr::T(body)) = &mut operation.request_body else { return };
    let Some(RefOr::T(content)) = body.content.get_mut("application/json") else { return };
    let path = path.strip_suffix(PREVIEW).unwrap_or(path);
    for file in EXAMPLES.files() {
        let Some(name) = file.path().file_stem().and_then(|name| name.to_str()) else { continue };
        let Ok(request) = serde_json::from_slice::<Value>(file.contents()) else { continue };
        if request["method"] == method && request["path"] == path {
            let text = PLACES.iter().fold(request["body"].to_string(), |text, place| text.replace(place, ID));
            let example = ExampleBuilder::new().value(serde_json::from_str(&text).ok()).build();
            content.examples.insert(name.to_owned(), example.into());
        }
    }
}

/// Adds the example of a JSON answer.
pub(super) fn add_answer(operation: &mut Operation) {
    let Some(id) = &operation.operation_id else { return };
    let Some(answer) = EXAMPLES.get_file(format!("answers/{id}.json")) else { return };
    let example: Option<Value> = serde_json::from_slice(answer.contents()).ok();
    for (status, response) in &mut operation.responses.responses {
        let RefOr::T(response) = response else { continue };
        // A comparison that takes long is answered with its job; the example is of one that is done.
        if !status.starts_with('2') || (id == "compare" && status == "202") {
            continue;
        }
        for (media_type, content) in &mut response.content {
            if let RefOr::T(content) = content
                && media_type.contains("json")
            {
                content.example.clone_from(&example);
            }
        }
    }
}
