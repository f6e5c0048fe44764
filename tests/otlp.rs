//! Spans of the real binary, as a collector receives them.

#![allow(clippy::unwrap_used, reason = "test code")]

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::mpsc;

use axum::routing::post;
use axum::{Json, Router};
use prosopon_formats::export;
use prosopon_geometry::Vector;
use prosopon_planning::phantom;
use serde_json::{Value, json};

/// Attributes that spans may have: ids, routes and stages.
const ATTRIBUTES: [&str; 9] =
    ["request_id", "method", "route", "status", "job.id", "session.id", "tenant", "job.kind", "stage"];

const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";
const CALLER: &str = "b7ad6b7169203331";

/// Accepts batches of spans on a free port.
fn collector() -> (String, mpsc::Receiver<Value>, tokio::runtime::Runtime) {
    let (sender, received) = mpsc::channel();
    let accept = move |Json(batch): Json<Value>| {
        sender.send(batch).unwrap();
        async { Json(json!({})) }
    };
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    runtime.spawn(axum::serve(listener, Router::new().route("/v1/traces", post(accept))).into_future());
    (url, received, runtime)
}

fn attribute<'a>(span: &'a Value, key: &str) -> &'a Value {
    let all = span["attributes"].as_array().unwrap();
    all.iter().find(|a| a["key"] == key).map_or(&Value::Null, |a| &a["value"])
}

#[test]
fn spans_of_a_request_its_job_and_the_stages_are_one_trace_without_content() {
    let (url, received, _runtime) = collector();
    let data = tempfile::tempdir().unwrap();
    let mut server = Command::new(env!("CARGO_BIN_EXE_prosopon"))
        .args(["serve", "--listen", "127.0.0.1:0", "--data"])
        .arg(data.path())
        .env("OTEL_EXPORTER_OTLP_ENDPOINT", url)
        // Spans do not depend on the log level.
        .env("RUST_LOG", "off")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.trim().strip_prefix("listening on ").unwrap().to_owned();

    let mut made = ureq::post(format!("{url}/v1/sessions")).send_json(json!({"label": "Erika-Mustermann"})).unwrap();
    let made: Value = made.body_mut().read_json().unwrap();
    let session = made["id"].as_str().unwrap();
    let head = phantom::head();
    let skin = phantom::surface_of(head.skin.as_ref(), &head.bounds(), 8.0).unwrap();
    for part in ["skin", "target"] {
        ureq::put(format!("{url}/v1/sessions/{session}/{part}")).send(&export::stl(&skin)).unwrap();
    }
    let compare = json!({"prediction": {"session": session, "part": "skin"}, "reference": {"session": session, "part": "target"}});
    let asked = ureq::post(format!("{url}/v1/compare"))
        .header("prefer", "respond-async")
        .header("traceparent", format!("00-{TRACE}-{CALLER}-01"))
        .send_json(compare);
    let job: Value = asked.unwrap().body_mut().read_json().unwrap();
    let job = job["id"].as_str().unwrap();
    let ended =
        ureq::get(format!("{url}/v1/jobs/{job}?wait_s=30")).call().unwrap().body_mut().read_to_string().unwrap();
    assert!(ended.contains("\"succeeded\""), "{ended}");
    // A job that fails: half of the skull lies outside the skin.
    let skull = phantom::surface_of(head.skull.as_ref(), &head.bounds(), 8.0).unwrap();
    let aside = skull.positions().iter().map(|p| p + Vector::new(90.0, 0.0, 0.0)).collect();
    let skull = skull.with_positions(aside).unwrap();
    ureq::put(format!("{url}/v1/sessions/{session}/skull")).send(&export::stl(&skull)).unwrap();
    let mut failed = ureq::post(format!("{url}/v1/sessions/{session}/field")).send_json(json!({})).unwrap();
    let failed: Value = failed.body_mut().read_json().unwrap();
    let failed = failed["id"].as_str().unwrap();
    let ended =
        ureq::get(format!("{url}/v1/jobs/{failed}?wait_s=30")).call().unwrap().body_mut().read_to_string().unwrap();
    assert!(ended.contains("\"failed\""), "{ended}");
    ureq::get(format!("{url}/livez")).header("traceparent", "nonsense").call().unwrap();
    // The service sends the remaining spans when it stops.
    assert!(Command::new("kill").args(["-TERM", &server.id().to_string()]).status().unwrap().success());
    assert!(server.wait().unwrap().success());

    let batches: Vec<Value> = received.try_iter().collect();
    let text = Value::from(batches.clone()).to_string();
    assert!(text.contains("\"service.name\"") && !text.contains("Mustermann"), "{text}");
    let scopes = batches.iter().flat_map(|b| b["resourceSpans"].as_array().unwrap());
    let scopes = scopes.flat_map(|r| r["scopeSpans"].as_array().unwrap());
    let spans: Vec<&Value> = scopes.flat_map(|s| s["spans"].as_array().unwrap()).collect();
    let named = |name: &'static str| spans.iter().copied().filter(move |s| s["name"] == name);

    // Of OTLP: kinds 1 internal, 2 server, 5 consumer; status 2 error.
    let request = named("POST /v1/compare").next().unwrap();
    assert_eq!((&request["kind"], &request["status"]["code"]), (&json!(2), &json!(0)), "{request}");
    assert_eq!((&request["traceId"], &request["parentSpanId"]), (&json!(TRACE), &json!(CALLER)));
    assert_eq!(attribute(request, "status")["intValue"], "202", "{request}");
    let job_span = named("job").find(|s| attribute(s, "job.id")["stringValue"] == job).unwrap();
    assert_eq!((&job_span["traceId"], &job_span["parentSpanId"]), (&json!(TRACE), &request["spanId"]));
    assert_eq!((&job_span["kind"], &job_span["status"]["code"]), (&json!(5), &json!(0)), "{job_span}");
    let failed_span = named("job").find(|s| attribute(s, "job.id")["stringValue"] == failed).unwrap();
    assert_eq!((&failed_span["kind"], &failed_span["status"]["code"]), (&json!(5), &json!(2)), "{failed_span}");
    let stages: Vec<&Value> = named("stage").filter(|s| s["parentSpanId"] == job_span["spanId"]).collect();
    let names: Vec<&str> = stages.iter().map(|s| attribute(s, "stage")["stringValue"].as_str().unwrap()).collect();
    assert_eq!(names, ["reading", "compare", "writing"]);
    assert!(stages.iter().all(|s| s["traceId"] == TRACE));
    let alone = named("GET /livez").next().unwrap();
    assert!(alone["traceId"] != TRACE && alone["parentSpanId"].as_str().is_none_or(str::is_empty), "{alone}");

    let allowed: BTreeSet<&str> = ATTRIBUTES.into();
    for span in &spans {
        let found = span["attributes"].as_array().unwrap().iter().map(|a| a["key"].as_str().unwrap());
        assert!(found.clone().all(|key| allowed.contains(key)), "{span}");
        assert!(span.get("events").and_then(Value::as_array).is_none_or(Vec::is_empty), "{span}");
    }
}
