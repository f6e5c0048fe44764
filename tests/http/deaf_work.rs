//! Computations that do not see their stop: the job ends, the service says that its threads are held, and the process ends.

use std::sync::atomic::Ordering;
use std::time::Duration;

use serde_json::json;

use crate::support::app::TestApp;

#[tokio::test]
async fn a_job_beyond_its_time_limit_ends_although_its_computation_goes_on() {
    let app = TestApp::with(|config| config.service.stuck_after = Duration::from_secs(3)).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    app.stand_in.is_deaf.store(true, Ordering::SeqCst);
    let job = app.solve(&session, &plan, json!({"max_wall_s": 1})).await;
    let ended = app.ended(&job).await.ok();
    assert_eq!(
        (&ended["status"], &ended["problem"]["type"]),
        (&json!("failed"), &json!("/problems/deadline-exceeded"))
    );
    let waiting = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.get("/readyz").await.problem(500, "internal");
    let metrics = app.get("/metrics").await;
    assert!(String::from_utf8_lossy(&metrics.body).contains("\nprosopon_jobs_ignoring_stop 1\n"), "{metrics:?}");
    let stuck = app.state.service.until_stuck().await;
    assert!(job.ends_with(&stuck.job.to_string()) && stuck.ignored >= Duration::from_secs(3), "{stuck}");
    app.get("/livez").await.problem(500, "internal");
    // What the process does then: it hands other jobs back and does not wait for the computation.
    app.state.service.shut_down(Duration::from_secs(60)).await;
    assert_eq!(app.get(&waiting).await.ok()["status"], "accepted");
    app.stand_in.release();
}

#[tokio::test]
async fn the_worker_goes_on_once_the_computation_has_seen_its_stop() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    app.stand_in.is_deaf.store(true, Ordering::SeqCst);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    app.post(&format!("{job}/cancel"), json!({})).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "cancelled");
    let next = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.stand_in.release();
    assert_eq!(app.ended(&next).await.ok()["status"], "succeeded");
    assert_eq!(app.get("/readyz").await.status, 200);
}
