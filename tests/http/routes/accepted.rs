use axum::http::StatusCode;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::skin;

#[tokio::test]
async fn an_accepted_job_is_answered_with_its_location_and_a_delay() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    let accepted = app.post(&format!("{session}/field"), json!({})).await;
    assert_eq!((accepted.status, accepted.header("retry-after")), (StatusCode::ACCEPTED, "1"));
    let job = accepted.json();
    assert_eq!((&job["kind"], &job["links"]["self"]), (&json!("field"), &json!(accepted.header("location"))));
}

#[tokio::test]
async fn a_repeated_request_returns_the_active_job() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let running = app.solve(&session, &plan, json!({})).await;
    app.until_step(&running, 1).await;
    assert_eq!(app.solve(&session, &plan, json!({})).await, running);
    assert_ne!(app.solve(&session, &plan, json!({"steps": 5})).await, running);

    let path = format!("{session}/field");
    let (field, twin) = tokio::join!(app.post(&path, json!({})), app.post(&path, json!({})));
    assert_eq!((twin.status, twin.header("location")), (StatusCode::ACCEPTED, field.header("location")));
    assert_eq!(twin.json()["id"], field.json()["id"]);
    let keyed = app.post_keyed(&path, "k", json!({})).await;
    assert_eq!(keyed.header("location"), field.header("location"));
    app.put_json(&format!("{path}/settings"), json!({"spacing_mm": 3})).await.ok();
    assert_ne!(app.post(&path, json!({})).await.header("location"), field.header("location"), "other settings");
    assert_eq!(app.post_keyed(&path, "k", json!({})).await.header("location"), field.header("location"));
    app.put_json(&format!("{path}/settings"), json!({})).await.ok();

    // The comparison would use another surface.
    app.upload(&format!("{session}/target"), skin()).await.ok();
    assert_ne!(app.solve(&session, &plan, json!({})).await, running);
    app.post(&format!("{running}/cancel"), json!({})).await.ok();
    let after = app.solve(&session, &plan, json!({})).await;
    assert_ne!(after, running, "one that is about to end is no answer");
    app.stand_in.release();
    assert_eq!(app.ended(&after).await.ok()["status"], "succeeded");
    assert_ne!(app.solve(&session, &plan, json!({})).await, after, "one that has ended neither");
}
