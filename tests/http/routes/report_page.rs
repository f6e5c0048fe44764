use axum::body::Body;
use axum::http::Method;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, stl};

#[tokio::test]
async fn the_report_is_one_self_contained_page() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.upload(&format!("{session}/target"), stl(&cube([0.0, -10.0, 0.0], 100.0))).await.ok();
    let job = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.ended(&job).await.ok();
    let page = app.get(&format!("{job}/report?format=html")).await;
    assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
    let text = String::from_utf8(page.body.to_vec()).unwrap();
    assert_eq!(text.matches("<img").count(), 3);
    assert_eq!(text.matches("src=\"data:image/png;base64,").count(), 2);
    assert_eq!(text.matches("src=\"data:image/svg+xml;base64,").count(), 1);
    for banned in ["<script", "http://", "https://", "<link", "url("] {
        assert!(!text.contains(banned), "{banned}");
    }
    for part in [
        "Plan, mm",
        "Mean movement",
        "Signed error against target",
        "Variance",
        "Warnings",
        "a stand-in",
        "SHA-256",
        "Steps",
        "Time, s",
        env!("CARGO_PKG_VERSION"),
        "Not a medical device",
        "@page",
    ] {
        assert!(text.contains(part), "{part}");
    }
    // 6 mm forward and 1.5 mm down.
    assert!(text.contains("<td>6.00</td><td>1.50</td>"), "the plan's row");
    let accepted = app.call(Method::GET, &format!("{job}/report"), &[("accept", "text/html")], Body::empty()).await;
    assert_eq!(accepted.body, page.body);
}
