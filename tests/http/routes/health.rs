use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::json;

use crate::support::app::TestApp;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn health_answers_fast_while_a_solve_runs() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    for path in ["/livez", "/readyz", "/metrics", &job] {
        let asked = Instant::now();
        assert_eq!(app.get(path).await.status, StatusCode::OK);
        assert!(asked.elapsed() < Duration::from_millis(500), "{path} took {:?}", asked.elapsed());
    }
    app.stand_in.release();
    app.ended(&job).await.ok();
}

#[tokio::test]
async fn a_stopping_service_is_not_ready_and_accepts_no_jobs() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    app.state.service.shut_down(Duration::from_secs(5)).await;
    app.get("/readyz").await.problem(503, "shutting-down");
    app.post(&format!("{session}/field"), json!({})).await.problem(503, "shutting-down");
    assert_eq!(app.get("/livez").await.status, StatusCode::OK);
}

#[tokio::test]
async fn metrics_name_requests_and_waiting_jobs() {
    let app = TestApp::new().await;
    app.get("/livez").await;
    let metrics = String::from_utf8(app.get("/metrics").await.body.to_vec()).unwrap();
    assert!(metrics.contains("prosopon_http_requests_total") && metrics.contains("prosopon_jobs_waiting"));
}
