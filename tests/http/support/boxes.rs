//! Jobs with the real numerics on two boxes as skin and skull.

use serde_json::{Value, json};

use crate::support::app::TestApp;

/// Creates a session with field, osteotomy and a coarse mesh; returns the session and the osteotomy.
pub(crate) async fn scene(app: &TestApp) -> (String, Value) {
    let session = app.session_with_surfaces().await;
    let settings = json!({"method": "uniform", "spacing_mm": 5, "envelope_spacing_mm": 5, "envelope_closing_mm": 10});
    app.put_json(&format!("{session}/field/settings"), settings).await.ok();
    let field = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!(field["status"], "succeeded", "{field}");
    let cut = json!({"cuts": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 1]}}]});
    let osteotomy = app.post(&format!("{session}/osteotomies"), cut).await.ok()["id"].clone();
    let settings = json!({"osteotomy": osteotomy, "edge_mm": 15, "depth_mm": 60, "skin_thickness_mm": 4});
    let mesh = app.finish(app.post(&format!("{session}/mesh"), settings).await).await;
    assert_eq!(mesh["status"], "succeeded", "{mesh}");
    (session, osteotomy)
}

/// Runs a job with a forward movement.
pub(crate) async fn solved(app: &TestApp, session: &str, osteotomy: &Value, forward_mm: f64, more: Value) -> String {
    let waypoints = json!([{"t": 1, "translation_mm": [0, -forward_mm, 0]}]);
    let plan = json!({"osteotomy": osteotomy, "paths": [{"segment": 1, "waypoints": waypoints}]});
    let plan = app.post(&format!("{session}/plans"), plan).await.ok()["id"].as_str().unwrap().to_owned();
    let job = app.solve(session, &plan, more).await;
    let view = app.ended(&job).await.ok();
    assert_eq!(view["status"], "succeeded", "{view}");
    job
}
