use axum::body::Body;
use axum::http::Method;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, stl};

#[tokio::test]
async fn a_step_is_compared_with_another_job_or_after_registration() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let first = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.ended(&first).await.ok();
    let second = app.solve(&session, &plan, json!({"steps": 4})).await;
    app.ended(&second).await.ok();
    let id = first.rsplit('/').next().unwrap();
    let path = format!("{second}/steps/2/error?reference={id}");
    let answer = app.get(&path).await;
    let tag = answer.header("etag").to_owned();
    assert_eq!(answer.ok()["reference"], format!("job {id} step 1"));
    assert_eq!(answer.json()["values_mm"], json!(vec![0.0; 8]));
    let known = app.call(Method::GET, &path, &[("if-none-match", &tag)], Body::empty()).await;
    assert_eq!(known.status.as_u16(), 304);
    app.get(&format!("{second}/steps/1/error?reference={id}")).await.problem(404, "no-reference");
    app.get(&format!("{second}/steps/2/error?register=true")).await.problem(404, "no-reference");
    app.get(&format!("{second}/steps/2/error?reference=x")).await.problem(400, "malformed-request");
    let skin = app.get(&format!("{second}/steps/2/skin?format=vtp&reference={id}")).await;
    assert!(String::from_utf8_lossy(&skin.body).contains("\"error_mm\""));
    let plain = app.get(&format!("{second}/steps/2/skin?format=vtp")).await;
    assert!(!String::from_utf8_lossy(&plain.body).contains("\"error_mm\""));
    app.upload(&format!("{session}/target"), stl(&cube([0.0, -10.0, 0.0], 100.0))).await.ok();
    let registered = app.get(&format!("{second}/steps/4/error?register=true")).await.ok();
    assert_eq!(
        (&registered["reference"], &registered["registration"]["region"]),
        (&json!("target"), &json!("unmoved"))
    );
    assert_eq!(registered["registration"]["residual_mm"], 0.1);
    assert_eq!(registered["warnings"][0]["message"], "hardly fits");
    let picture = app.get(&format!("{second}/steps/4/error.png?register=true")).await;
    assert_eq!(picture.header("content-type"), "image/png");
}
