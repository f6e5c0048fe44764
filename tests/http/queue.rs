//! The queue: replaced jobs, deadlines, late cancels, limits.

use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::shapes::{skin, skull};

#[tokio::test]
async fn a_newer_job_on_the_plan_takes_the_place_of_one_that_waits() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let running = app.solve(&session, &plan, json!({})).await;
    app.until_step(&running, 1).await;
    let old = app.solve(&session, &plan, json!({"steps": 2})).await;
    let newer = app.solve(&session, &plan, json!({"steps": 3, "supersede": true})).await;
    let view = app.get(&old).await.ok();
    assert_eq!(view["status"], "cancelled");
    assert_eq!(view["superseded_by"], newer.rsplit('/').next().unwrap());
    let events = app.call(Method::GET, &format!("{old}/events"), &[], Body::empty()).await;
    assert!(String::from_utf8(events.body.to_vec()).unwrap().contains("superseded_by"));
    app.stand_in.release();
    for job in [running, newer] {
        assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    }
}

#[tokio::test]
async fn a_job_that_computes_for_too_long_is_stopped_and_its_steps_stay() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(2);
    let job = app.solve(&session, &plan, json!({"max_wall_s": 1})).await;
    let ended = app.ended(&job).await.ok();
    assert_eq!(
        (&ended["status"], &ended["problem"]["type"]),
        (&json!("failed"), &json!("/problems/deadline-exceeded"))
    );
    assert_eq!(ended["step"], 2);
    assert_eq!(app.get(&format!("{job}/steps/2/frame")).await.status, StatusCode::OK);
    app.stand_in.release();
    let problem = app.post(&format!("{session}/jobs"), json!({"plan": plan, "max_wall_s": 1e9})).await;
    assert_eq!(problem.problem(422, "invalid-request")["errors"][0]["pointer"], "/max_wall_s");
}

/// Cancels at every moment around the end of a job: a job whose cancel was accepted never succeeds.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_that_was_cancelled_never_succeeds() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let (mut stopped, mut late) = (0, 0);
    for round in 0..30u64 {
        app.stand_in.hold_after(1);
        let job = app.solve(&session, &plan, json!({"steps": 2, "max_wall_s": 100 + round})).await;
        app.until_step(&job, 1).await;
        app.stand_in.release();
        tokio::time::sleep(Duration::from_micros(400 * round)).await;
        let cancel = app.post(&format!("{job}/cancel"), json!({})).await;
        let ended = app.ended(&job).await.ok();
        if cancel.status == StatusCode::ACCEPTED {
            stopped += 1;
            assert_eq!(ended["status"], "cancelled", "round {round}");
        } else {
            late += 1;
            cancel.problem(409, "wrong-state");
            assert_eq!(ended["status"], "succeeded", "round {round}");
        }
    }
    assert_eq!(stopped + late, 30);
}

#[tokio::test]
async fn a_tenant_has_its_own_bound() {
    let app = TestApp::with(|config| config.service.max_waiting_tenant = 1).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let running = app.solve(&session, &plan, json!({})).await;
    app.until_step(&running, 1).await;
    app.solve(&session, &plan, json!({"steps": 2})).await;
    let full = app.post(&format!("{session}/jobs"), json!({"plan": plan, "steps": 3})).await;
    full.problem(429, "tenant-queue-full");
    assert!(!full.header("retry-after").is_empty());
    app.solve(&session, &plan, json!({"steps": 4, "supersede": true})).await;
    app.stand_in.release();
}

#[tokio::test]
async fn a_session_may_store_so_much() {
    let app = TestApp::with(|config| config.service.session_quota = 900).await;
    let session = app.session().await;
    app.upload(&format!("{session}/skin"), skin()).await.ok();
    let mut refused = None;
    for part in ["skull", "target"] {
        let answer = app.upload(&format!("{session}/{part}"), skull()).await;
        if !answer.status.is_success() {
            refused = Some(answer);
            break;
        }
    }
    let refused = refused.expect("three surfaces are above the quota");
    assert_eq!(refused.problem(429, "quota-full")["allowed_bytes"], 900);
    assert!(app.get(&session).await.ok()["bytes"].as_u64().unwrap() <= 900);
    // A small request still works; the same upload is refused again.
    assert_eq!(app.get("/readyz").await.status, StatusCode::OK);
    let large = app.upload(&format!("{session}/target"), vec![0; 4000]).await;
    large.problem(429, "quota-full");
}

#[tokio::test]
async fn sessions_that_nobody_uses_expire() {
    let app = TestApp::with(|config| config.service.session_retention = Some(Duration::from_millis(300))).await;
    let session = app.session().await;
    assert!(app.get(&session).await.ok()["expires_at"].is_string());
    app.state.service.keep_house().await.unwrap();
    assert_eq!(app.get(&session).await.status, StatusCode::OK);
    tokio::time::sleep(Duration::from_millis(350)).await;
    app.state.service.keep_house().await.unwrap();
    app.get(&session).await.problem(410, "gone");
    let audit = std::fs::read_dir(app.directory().join("audit")).unwrap().next().unwrap().unwrap();
    assert!(std::fs::read_to_string(audit.path()).unwrap().contains(r#""who":"retention""#));
}

async fn lines(app: &TestApp, job: &str, last: &str) -> Vec<Value> {
    let headers = [("accept", "application/x-ndjson"), ("last-event-id", last)];
    let answer = app.call(Method::GET, &format!("{job}/events"), &headers, Body::empty()).await;
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[tokio::test]
async fn a_client_whose_history_is_gone_is_told_to_look_again() {
    let app = TestApp::with(|config| config.service.event_retention = Duration::ZERO).await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    app.ended(&job).await.ok();
    let all = lines(&app, &job, "0").await;
    let newest = all.last().unwrap()["id"].as_u64().unwrap();
    // An event id that does not exist yet: all events are sent again.
    let other_life = lines(&app, &job, "100000").await;
    assert_eq!((&other_life[0]["event"], other_life.len()), (&json!("resync"), all.len() + 1));

    tokio::time::sleep(Duration::from_millis(5)).await;
    app.state.service.keep_house().await.unwrap();
    let app = app.restart().await;
    let left = lines(&app, &job, "2").await;
    let names: Vec<&str> = left.iter().map(|e| e["event"].as_str().unwrap()).collect();
    assert_eq!(names, ["resync", "end"]);
    assert_eq!((left[0]["id"].as_u64(), left[1]["id"].as_u64()), (Some(newest - 1), Some(newest)));
    assert_eq!(left[0]["data"]["links"]["self"], job);
    assert_eq!(lines(&app, &job, &(newest - 1).to_string()).await.len(), 1, "who has all but the last needs no resync");
}

#[tokio::test]
async fn silence_is_broken_by_heartbeats() {
    let app = TestApp::with(|config| config.limits.heartbeat = Duration::from_millis(20)).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.until_step(&job, 1).await;
    let release = async {
        tokio::time::sleep(Duration::from_millis(150)).await;
        app.stand_in.release();
    };
    let (path, none) = (format!("{job}/events"), [("accept", "text/event-stream")]);
    let stream = app.call(Method::GET, &path, &none, Body::empty());
    let (told, stream, ()) = tokio::join!(lines(&app, &job, "0"), stream, release);
    assert!(told.iter().any(|line| line["event"] == "heartbeat"));
    let text = String::from_utf8(stream.body.to_vec()).unwrap();
    let retry: u64 = text.lines().next().unwrap().strip_prefix("retry: ").unwrap().parse().unwrap();
    assert!((1500..3000).contains(&retry), "{retry}");
    assert!(text.lines().any(|line| line.starts_with(':')));
}
