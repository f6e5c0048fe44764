use axum::http::StatusCode;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{skin, skull};

#[tokio::test]
async fn a_repeated_request_with_the_same_key_gets_the_first_answer() {
    let app = TestApp::new().await;
    let first = app.post_keyed("/v1/sessions", "k1", json!({"label": "a", "settings": {"steps": 3}})).await;
    // The same payload with its members in another order.
    let headers = [("content-type", "application/json"), ("idempotency-key", "k1")];
    let body = r#"{"settings": {"steps": 3}, "label": "a"}"#;
    let again = app.call(axum::http::Method::POST, "/v1/sessions", &headers, body).await;
    assert_eq!(again.status, StatusCode::CREATED);
    assert_eq!((again.json(), again.header("location")), (first.json(), first.header("location")));
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(app.get("/v1/sessions").await.ok()["sessions"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn another_payload_or_path_with_the_same_key_is_refused() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    app.post_keyed("/v1/sessions", "k1", json!({"label": "a"})).await.ok();
    app.post_keyed("/v1/sessions", "k1", json!({"label": "b"})).await.problem(422, "idempotency-mismatch");
    app.post_keyed(&format!("{session}/field"), "k1", json!({})).await.problem(422, "idempotency-mismatch");
    app.post_keyed("/v1/sessions", &"x".repeat(300), json!({})).await.problem(400, "malformed-request");
}

#[tokio::test]
async fn a_key_is_remembered_across_a_restart() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let path = format!("{session}/jobs");
    let first = app.post_keyed(&path, "solve-1", json!({"plan": plan})).await;
    assert_eq!(first.status, StatusCode::ACCEPTED);
    app.finish(app.post_keyed(&path, "solve-1", json!({"plan": plan})).await).await;
    let app = app.restart().await;
    let again = app.post_keyed(&path, "solve-1", json!({"plan": plan})).await;
    assert_eq!((again.status, again.header("location")), (StatusCode::ACCEPTED, first.header("location")));
    assert_eq!(again.header("retry-after"), "1");
    let jobs = app.get("/v1/jobs").await.ok()["jobs"].as_array().unwrap().clone();
    assert_eq!(jobs.iter().filter(|j| j["kind"] == "solve").count(), 1);
}

#[tokio::test]
async fn a_refused_request_does_not_use_up_its_key() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let path = format!("{session}/field");
    app.post_keyed(&path, "f", json!({})).await.problem(409, "missing-input");
    app.upload(&format!("{session}/skin"), skin()).await.ok();
    app.upload(&format!("{session}/skull"), skull()).await.ok();
    app.post_keyed(&path, "f", json!({})).await.ok();
}
