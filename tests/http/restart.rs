//! An orderly stop, and the next start on the same directory.

use std::process::Command;
use std::sync::atomic::Ordering;
use std::time::Duration;

use prosopon_store::{Store, StoreError};
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::binary::{Server, serve};
use crate::support::tissue_mesh::slab;

#[tokio::test]
async fn all_results_are_unchanged_after_a_restart() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({})).await;
    app.ended(&job).await.ok();
    let paths = [
        session.clone(),
        job.clone(),
        format!("{job}/report"),
        format!("{session}/field"),
        format!("{session}/mesh"),
        format!("{session}/plans/{plan}"),
        format!("{job}/steps/6/frame"),
        format!("{job}/steps/6/skin"),
        format!("{job}/topology"),
    ];
    let mut before = Vec::new();
    for path in &paths {
        before.push(app.get(path).await.body);
    }
    let app = app.restart().await;
    for (path, before) in paths.iter().zip(before) {
        assert_eq!(app.get(path).await.body, before, "{path}");
    }
    // The session remains usable: the stored mesh still matches these inputs.
    let job = app.solve(&session, &plan, json!({})).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
}

#[tokio::test]
async fn a_job_interrupted_by_a_stop_keeps_its_steps_and_ends() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(2);
    let job = app.solve(&session, &plan, json!({"steps": 4})).await;
    app.until_step(&job, 2).await;
    let step = app.get(&format!("{job}/steps/2/frame")).await;
    let app = app.restart().await;
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["status"], &ended["step"]), (&json!("succeeded"), &json!(4)));
    assert_eq!(ended["attempt"], 1, "a stop in good order is no failed attempt");
    let again = app.get(&format!("{job}/steps/2/frame")).await;
    assert_eq!((again.body, again.headers["etag"].clone()), (step.body, step.headers["etag"].clone()));
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), 2);
    let events = String::from_utf8(app.get(&format!("{job}/events")).await.body.to_vec()).unwrap();
    assert!(events.contains(r#""status":"interrupted""#));
}

#[tokio::test]
async fn a_directory_in_use_is_refused() {
    let app = TestApp::new().await;
    assert!(matches!(Store::open(app.directory()).await, Err(StoreError::InUse)));
}

#[cfg(unix)]
#[test]
fn a_terminated_service_exits_with_success() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(directory.path(), &[]);
    let id = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert!(server.child.wait().unwrap().success());
}

/// After SIGTERM no new jobs start, running jobs may finish, and then the process exits.
#[cfg(target_os = "linux")]
#[test]
fn a_stop_waits_for_a_running_job() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_DRAIN_S", "60");
    let mut server = Server::spawn(command);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let job = server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "nonlinear", "steps": 8})).ok();
    let own = job["links"]["self"].as_str().unwrap().to_owned();
    while server.get(&own).ok()["step"].as_u64().unwrap() < 1 {
        std::thread::park_timeout(Duration::from_millis(10));
    }
    let pid = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
    server.child.wait().unwrap();
    let server = Server::start(directory.path(), &[]);
    let view = server.get(&own).ok();
    assert_eq!((&view["status"], &view["attempt"]), (&json!("succeeded"), &json!(1)), "{view}");
}
