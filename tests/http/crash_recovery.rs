//! What a start finds after the process was killed.

use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::binary::Server;
use crate::support::shapes::skin;
use crate::support::tissue_mesh::slab;

#[test]
fn a_session_is_complete_after_a_kill() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/skin"), &skin()).ok();
    let before = server.get(&session).ok();
    drop(server);
    let server = Server::start(directory.path(), &[]);
    assert_eq!(server.get(&session).ok(), before);
}

/// Files of the store, `SESSION/NAME`.
fn blobs(data: &Path) -> Vec<String> {
    let names = |path: &Path| -> Vec<String> {
        std::fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    };
    let sessions = names(&data.join("blobs"));
    sessions
        .iter()
        .flat_map(|s| names(&data.join("blobs").join(s)).into_iter().map(move |f| format!("{s}/{f}")))
        .collect()
}

/// After a kill between two steps and during an upload, finished data remain, unfinished data are gone, and the job
/// ends the same.
#[test]
fn a_killed_solve_keeps_its_steps_and_runs_again() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let (osteotomy, jaw) = server.cut(&session);
    let mesh = json!({ "osteotomy": osteotomy, "edge_mm": 8.0 });
    server.finish(&server.post(&format!("{session}/mesh"), &mesh));
    let waypoints = json!([{ "t": 1, "translation_mm": [0, -6, -1.5] }]);
    let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
    let plan = server.post(&format!("{session}/plans"), &plan).ok()["id"].clone();
    let solve = json!({ "plan": plan, "model": "mixed", "steps": 8 });
    let job = server.post(&format!("{session}/jobs"), &solve).ok()["links"]["self"].as_str().unwrap().to_owned();

    let mut progress = 0.0;
    let deadline = Instant::now() + Duration::from_secs(600);
    let steps = loop {
        let view = server.get(&job).ok();
        let now = view["progress"].as_f64().unwrap();
        assert!(now >= progress && now < 1.0, "{progress} then {view}");
        progress = now;
        assert!(view["status"] == "accepted" || view["status"] == "running", "{view}");
        if view["step"].as_u64().unwrap() >= 2 {
            break view["step"].as_u64().unwrap();
        }
        assert!(Instant::now() < deadline, "{view}");
        std::thread::park_timeout(Duration::from_millis(20));
    };
    let frames: Vec<Vec<u8>> = (1..=steps).map(|k| server.get(&format!("{job}/steps/{k}/frame")).body).collect();
    let parts = server.get(&session).ok()["parts"].clone();
    let mut half = TcpStream::connect(server.address()).unwrap();
    let head = format!("PUT {session}/target HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50000000\r\n\r\n");
    half.write_all(head.as_bytes()).unwrap();
    half.write_all(&vec![0; 20_000_000]).unwrap();
    drop(server);
    let left = blobs(directory.path());

    let server = Server::start(directory.path(), &[]);
    let view = server.get(&job).ok();
    let status = view["status"].as_str().unwrap();
    assert!(["accepted", "running", "interrupted"].contains(&status), "{view}");
    assert!(view["step"].as_u64().unwrap() >= steps);
    assert_eq!(server.get(&session).ok()["parts"], parts);
    for (k, frame) in (1..).zip(&frames) {
        assert!(server.get(&format!("{job}/steps/{k}/frame")).body == *frame, "step {k}");
    }
    let now = blobs(directory.path());
    let is_half = |name: &&String| name.contains('#');
    assert!(left.iter().any(|name| is_half(&name)), "the upload was under way: {left:?}");
    // The restarted job may be writing a step at this moment, under a new name.
    assert_eq!(now.iter().filter(is_half).find(|name| left.contains(name)), None);

    let accepted = server.get(&job);
    let ended = server.finish(&accepted);
    assert_eq!((&ended["attempt"], &ended["step"], &ended["progress"]), (&json!(2), &json!(8), &json!(1.0)));
    assert_eq!(ended["residuals"].as_array().unwrap().len(), 8);
    for (k, frame) in (1..).zip(&frames) {
        assert!(server.get(&format!("{job}/steps/{k}/frame")).body == *frame, "step {k} is computed to the same bytes");
    }
    let report = server.get(&format!("{job}/report")).ok();
    let phase = |name: &str| report["phases"][name].as_f64().unwrap();
    let sum: f64 = ["surfaces_s", "field_s", "cut_s", "mesh_s", "plan_s", "solve_s"].map(phase).iter().sum();
    assert!((sum - phase("total_s")).abs() < 1e-9 && phase("solve_s") > 0.0);
    let events = String::from_utf8(server.get(&format!("{job}/events")).body).unwrap();
    let statuses: Vec<Value> = events
        .lines()
        .filter_map(|l| serde_json::from_str::<Value>(l.strip_prefix("data: ")?).ok())
        .filter_map(|data| data.get("status").cloned())
        .collect();
    assert_eq!(statuses, ["accepted", "running", "interrupted", "accepted", "running", "succeeded"]);
}

/// A job whose cancel was answered with 202 never succeeds, however soon the service is killed after the answer.
#[test]
fn an_accepted_cancel_survives_a_kill() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let mut caught_running = 0;
    for round in 0..8u64 {
        // Different tolerances make different jobs; with 200 steps, a job still runs when it is cancelled.
        let tolerance = 0.05 + 1e-4 * round as f64;
        let solve = json!({"plan": plan, "model": "nonlinear", "steps": 200, "penetration_tolerance_mm": tolerance});
        let job = server.post(&format!("{session}/jobs"), &solve).ok()["links"]["self"].as_str().unwrap().to_owned();
        let deadline = Instant::now() + Duration::from_secs(60);
        while round % 4 != 0 && server.get(&job).ok()["phase"] != "solve" {
            assert!(Instant::now() < deadline);
            std::thread::park_timeout(Duration::from_millis(5));
        }
        let cancelled = server.post(&format!("{job}/cancel"), &json!({}));
        assert_eq!(cancelled.status, 202);
        caught_running += u32::from(cancelled.json()["status"] == "running");
        server.child.kill().unwrap();
        server.child.wait().unwrap();
        server = Server::start(directory.path(), &[]);
        let view = server.get(&format!("{job}?wait_s=30")).ok();
        assert_eq!(view["status"], "cancelled", "round {round}: {view}");
        let events = server.get_lines(&format!("{job}/events"));
        assert_eq!(events.last().unwrap()["data"]["status"], "cancelled");
        server.post(&format!("{job}/cancel"), &json!({})).refused(409, "wrong-state", "cancelled");
    }
    assert!(caught_running > 0, "no job was caught while it ran");
}

/// Restarts on a database as a killed process leaves it: the job is running in its `attempt`th attempt.
async fn mark_as_crashed(app: TestApp, job: &str, attempt: u32) -> TestApp {
    let id = job.rsplit('/').next().unwrap().to_owned();
    app.restart_after(async move |directory| {
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(directory.join("prosopon.sqlite"));
        let pool = sqlx::SqlitePool::connect_with(options).await.unwrap();
        sqlx::query("UPDATE jobs SET state = 'running', attempt = ?, fault = NULL WHERE id = ?")
            .bind(attempt)
            .bind(id)
            .execute(&pool)
            .await
            .unwrap();
        pool.close().await;
    })
    .await
}

#[tokio::test]
async fn a_job_fails_after_two_crashed_attempts() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    let app = mark_as_crashed(app, &job, 1).await;
    assert_eq!(app.ended(&job).await.ok()["attempt"], 2, "the second attempt is made");
    let app = mark_as_crashed(app, &job, 2).await;
    let ended = app.get(&job).await.ok();
    assert_eq!((&ended["status"], &ended["problem"]["type"]), (&json!("failed"), &json!("/problems/job-interrupted")));
    assert_eq!((&ended["problem"]["job_status"], &ended["problem"]["attempts"]), (&json!("failed"), &json!(2)));
    assert_eq!(app.get(&format!("{job}/steps/1/frame")).await.status, 200);
}

#[tokio::test]
async fn files_without_a_row_are_deleted_at_start() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    let id = session.rsplit('/').next().unwrap().to_owned();
    let orphan = app.directory().join("blobs").join(&id).join("left-behind#1");
    std::fs::write(&orphan, b"half").unwrap();
    let app = app.restart().await;
    assert!(!orphan.exists());
    assert_eq!(app.get(&format!("{session}/skin")).await.status, 200);
}
