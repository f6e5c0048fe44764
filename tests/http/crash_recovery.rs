//! The real binary: its address, its shutdown, and the state after a kill.

use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::binary::{Server, serve};
use crate::support::shapes::skin;

#[test]
fn a_killed_service_has_everything_when_it_starts_again() {
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

/// After a kill between two steps and during an upload, finished data remain, unfinished data are gone, and the job ends the same.
#[test]
fn a_solve_that_was_killed_keeps_its_steps_and_runs_again() {
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
fn a_cancel_that_was_answered_outlives_a_kill() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &crate::routes::tissue::slab(1.0)).ok();
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

#[test]
fn a_database_of_another_format_is_named_with_what_to_do() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("prosopon.sqlite"), [b'x'; 5000]).unwrap();
    let output = serve(directory.path(), "127.0.0.1:0").output().unwrap();
    assert!(!output.status.success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(
        message.contains("not of this version's format") && message.contains("name another directory"),
        "{message}"
    );
    assert!(message.contains(&directory.path().display().to_string()), "{message}");
}

#[cfg(unix)]
#[test]
fn a_terminated_service_stops_in_good_order() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(directory.path(), &[]);
    let id = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert!(server.child.wait().unwrap().success());
}

#[test]
fn an_address_beyond_loopback_is_refused_with_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let output = serve(directory.path(), "0.0.0.0:0").output().unwrap();
    assert!(!output.status.success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("without authentication") && message.contains("0.0.0.0:0"), "{message}");
}

#[test]
fn the_description_is_printed() {
    let output = Command::new(env!("CARGO_BIN_EXE_prosopon")).arg("openapi").output().unwrap();
    assert!(output.stdout == include_bytes!("../../api/openapi.json"));
}

/// The store of an earlier demo may be of any version, and its results must not be mistaken for new ones.
#[test]
fn a_demo_begins_anew_in_a_directory_that_was_used_before() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::create_dir_all(at("service/blobs/x")).unwrap();
    std::fs::create_dir(at("steps")).unwrap();
    for name in ["service/prosopon.sqlite", "service/blobs/x/y", "report.json", "steps/07.glb", "notes.txt"] {
        std::fs::write(at(name), [b'x'; 5000]).unwrap();
    }
    let output = Command::new(env!("CARGO_BIN_EXE_prosopon"))
        .args(["demo", "--skin", "absent.stl", "--skull", "absent.stl", "--out"])
        .arg(directory.path())
        .output()
        .unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && message.contains("absent.stl"), "{message}");
    for (name, stays) in
        [("service/blobs/x/y", false), ("report.json", false), ("steps/07.glb", false), ("notes.txt", true)]
    {
        assert_eq!(at(name).exists(), stays, "{name}");
    }
}

/// A process whose memory limit leaves nothing for a solve refuses the job and keeps running.
#[test]
fn a_job_that_would_not_fit_into_memory_is_refused_with_what_would() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_MEMORY_MB", "1");
    let server = Server::spawn(command);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &crate::routes::tissue::slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let ended = server.end(&server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "linear"})));
    let problem = &ended["problem"];
    assert_eq!(
        (&ended["status"], &problem["type"]),
        (&json!("failed"), &json!("/problems/not-enough-memory")),
        "{ended}"
    );
    assert!(problem["needed_mb"].as_f64().unwrap() > 30.0 && problem["allowed_mb"] == 0.0, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("would fit"), "{problem}");
    assert_eq!(server.get("/readyz").status, 200);
}
