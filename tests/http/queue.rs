//! The queue: replaced jobs, deadlines, late cancels, limits.

use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::json;

use crate::support::app::TestApp;

#[tokio::test]
async fn one_job_runs_and_later_jobs_wait_in_order() {
    let app = TestApp::with(|config| config.service.max_waiting = 2).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let first = app.solve(&session, &plan, json!({})).await;
    app.until_step(&first, 1).await;
    let second = app.solve(&session, &plan, json!({"steps": 2})).await;
    let body = json!({"plan": plan, "steps": 3});
    let accepted = app.post_keyed(&format!("{session}/jobs"), "third", body.clone()).await;
    assert_eq!(accepted.ok()["queue_position"], 2, "in the answer 202");
    let replayed = app.post_keyed(&format!("{session}/jobs"), "third", body).await;
    assert_eq!(replayed.json(), accepted.json());
    let third = accepted.header("location").to_owned();
    assert_eq!(app.post(&format!("{session}/jobs"), json!({"plan": plan, "steps": 3})).await.ok()["queue_position"], 2);
    assert_eq!(app.get(&second).await.ok()["queue_position"], 1);
    assert_eq!(app.get(&third).await.ok()["queue_position"], 2);
    let full = app.post(&format!("{session}/jobs"), json!({"plan": plan, "steps": 4})).await;
    full.problem(503, "queue-full");
    assert_eq!(full.header("retry-after"), "10");
    app.stand_in.release();
    for job in [first, second, third] {
        assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    }
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), 3);
}

#[tokio::test]
async fn a_superseding_job_cancels_the_waiting_one() {
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
async fn a_job_beyond_its_time_limit_fails_and_keeps_its_steps() {
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
async fn a_cancelled_job_never_succeeds() {
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
async fn a_tenant_has_its_own_limit_of_waiting_jobs() {
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
