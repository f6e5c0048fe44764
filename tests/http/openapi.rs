//! The OpenAPI description: what is served, printed and routed.

use std::process::Command;

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::Value;

use crate::support::app::TestApp;

#[tokio::test]
async fn the_description_and_its_documentation_are_served() {
    let app = TestApp::new().await;
    let description = app.get("/openapi.json").await.ok();
    assert_eq!(description["openapi"], "3.1.0");
    let checked_in: Value = serde_json::from_str(include_str!("../../api/openapi.json")).unwrap();
    assert_eq!(description, checked_in);
    let docs = app.get("/docs/").await;
    let page = String::from_utf8(docs.body.to_vec()).unwrap();
    assert!(docs.status.is_success() && page.contains("swagger-ui"));
    assert!(!page.contains("https://"), "works offline");
}

/// Every path and method of the OpenAPI description is routed.
#[tokio::test]
async fn every_described_path_and_method_is_routed() {
    let app = TestApp::new().await;
    let description: Value = serde_json::from_str(include_str!("../../api/openapi.json")).unwrap();
    let nil = "00000000-0000-0000-0000-000000000000";
    for (path, item) in description["paths"].as_object().unwrap() {
        let mut filled = path.replace("{k}", "1").replace("{segment}", "1");
        while let Some((before, rest)) = filled.split_once('{') {
            filled = format!("{before}{nil}{}", rest.split_once('}').unwrap().1);
        }
        for method in item.as_object().unwrap().keys() {
            let method: Method = method.to_uppercase().parse().unwrap();
            let answer = app.call(method.clone(), &filled, &[], Body::empty()).await;
            assert_ne!(answer.status, StatusCode::METHOD_NOT_ALLOWED, "{method} {path}");
            let body = String::from_utf8_lossy(&answer.body).into_owned();
            assert!(!body.contains("nothing at this path"), "{method} {path}");
        }
    }
}

#[test]
fn the_openapi_command_prints_the_description() {
    let output = Command::new(env!("CARGO_BIN_EXE_prosopon")).arg("openapi").output().unwrap();
    assert!(output.stdout == include_bytes!("../../api/openapi.json"));
}
