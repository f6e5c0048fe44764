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
    // Before, after, movement and error from five sides each, and the profile.
    assert_eq!(text.matches("<img").count(), 21);
    assert_eq!(text.matches("src=\"data:image/png;base64,").count(), 20);
    assert_eq!(text.matches("src=\"data:image/svg+xml;base64,").count(), 1);
    for banned in ["<script", "http://", "https://", "<link", "url("] {
        assert!(!text.contains(banned), "{banned}");
    }
    let policy = page.header("content-security-policy");
    assert!(policy.starts_with("default-src 'none'; style-src 'unsafe-inline'; img-src data:;"), "{policy}");
    for part in [
        "Predicted face",
        "Mean movement of the skin",
        "three-quarter, patient's right",
        "Signed error against target",
        "Variance",
        "Warnings",
        "A stand-in",
        "SHA-256",
        "Steps",
        "Time, s",
        env!("CARGO_PKG_VERSION"),
        "Not a medical device",
        "@page",
        "6.0 mm forward",
        "1.5 mm down",
    ] {
        assert!(text.contains(&escaped(part)), "{part}");
    }
    let accepted = app.call(Method::GET, &format!("{job}/report"), &[("accept", "text/html")], Body::empty()).await;
    assert_eq!(accepted.body, page.body);
}

/// A text as the page has it.
fn escaped(text: &str) -> String {
    text.replace('\'', "&#x27;")
}
