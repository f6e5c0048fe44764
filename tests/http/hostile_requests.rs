//! Requests with unknown paths, methods or bodies.

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};

use crate::api_examples::{Example, examples};
use crate::support::app::TestApp;

#[tokio::test]
async fn whatever_goes_wrong_is_a_problem() {
    let app = TestApp::new().await;
    app.get("/nowhere").await.problem(404, "not-found");
    app.get("/docs/nothing.js").await.problem(404, "not-found");
    app.get("/v1/sessions/x").await.problem(404, "not-found");
    app.get("/v1/sessions?limit=many").await.problem(400, "malformed-request");
    app.get("/v1/sessions?colour=red").await.problem(400, "malformed-request");
    let wrong = app.call(Method::PATCH, "/v1/sessions", &[], Body::empty()).await;
    wrong.problem(405, "method-not-allowed");
    assert!(wrong.header("allow").contains("POST"));
    let json_type = [("content-type", "application/json")];
    app.call(Method::POST, "/v1/sessions", &json_type, "{").await.problem(400, "malformed-request");
    app.call(Method::POST, "/v1/sessions", &json_type, r#"{"label": 1e999}"#).await.problem(400, "malformed-request");
    app.call(Method::POST, "/v1/sessions", &[("content-type", "text/plain")], "{}")
        .await
        .problem(415, "unsupported-format");
    let packed = [("content-type", "application/json"), ("content-encoding", "gzip")];
    app.call(Method::POST, "/v1/sessions", &packed, "{}").await.problem(415, "unsupported-format");
    app.call(Method::POST, "/v1/sessions", &json_type, "[]").await.problem(422, "invalid-request");
    let unknown = app.post("/v1/sessions", json!({"name": "Jane Doe"})).await.problem(422, "invalid-request");
    assert_eq!(unknown["errors"][0]["pointer"], "/name");
    let long = app.post("/v1/sessions", json!({"label": "x".repeat(201)})).await.problem(422, "invalid-request");
    assert_eq!(long["errors"][0]["pointer"], "/label");
    let huge = json!({"label": "x".repeat(9 << 20)});
    let problem = app.post("/v1/sessions", huge).await.problem(413, "too-large");
    assert_eq!(problem["allowed_bytes"], 8 << 20);
    assert!(problem["detail"].as_str().unwrap().contains("8388608"), "{problem}");
}

#[tokio::test]
async fn a_parameter_that_cannot_be_read_is_named() {
    let app = TestApp::new().await;
    let slice = format!("{}/field/slice.png", app.session().await);
    for (path, name, detail) in [
        ("/v1/sessions?limit=many", "/limit", "expected a whole number within range"),
        ("/v1/sessions?colour=red", "/colour", "unknown field `colour`, expected `before` or `limit`"),
        ("/v1/jobs?session=x", "/session", "expected a UUID"),
        ("/v1/jobs?status=x", "/status", "`x` is not the status of a job"),
        (&format!("{slice}?axis=q&offset_mm=0"), "/axis", "unknown value `q`, expected one of `x`, `y`, `z`"),
        (&format!("{slice}?axis=x&offset_mm=near"), "/offset_mm", "expected a number"),
        (&format!("{slice}?axis=x"), "/offset_mm", "missing field `offset_mm`"),
    ] {
        let problem = app.get(path).await.problem(400, "malformed-request");
        assert_eq!((&problem["detail"], &problem["errors"][0]["pointer"]), (&json!(detail), &json!(name)), "{path}");
    }
    let far = app.get(&format!("{slice}?axis=x&offset_mm=1e300")).await.problem(422, "invalid-request");
    assert_eq!(far["errors"], json!([{"pointer": "/offset_mm", "detail": "is 1e300, allowed is -10000 to 10000"}]));
}

#[tokio::test]
async fn refused_values_are_told_in_plain_words() {
    let app = TestApp::new().await;
    let path = format!("{}/landmarks", app.session().await);
    let nines = "9".repeat(300);
    for (body, pointer, detail) in [
        ("5", "", "expected an object, found 5"),
        ("[]", "", "expected an object, found a list"),
        (r#"{"points": 1}"#, "/points", "expected an object, found 1"),
        (r#"{"points": {"ans": ["x", 1, 2]}}"#, "/points/ans/0", "expected a number, found \"x\""),
        (r#"{"points": {"ans": [1, 2]}}"#, "/points/ans", "expected a list of 3, found 2 elements"),
        (r#"{"points": {"ans": [1, 2, 3, 4]}}"#, "/points/ans", "expected a list of 3, found 4 elements"),
        (r#"{"points": {}, "points": {}}"#, "/points", "duplicate field `points`"),
        (r#"{"points": {"ans": [1, 2, 3], "ans": [1, 2, 4]}}"#, "/points/ans", "duplicate field `ans`"),
        (
            &format!(r#"{{"points": {{"ans": [1, 2, {nines}]}}}}"#),
            "/points/ans/2",
            "is 1e300, allowed is -10000 to 10000",
        ),
    ] {
        let answer = app.call(Method::PUT, &path, &[("content-type", "application/json")], body.to_owned()).await;
        let problem = answer.problem(422, "invalid-request");
        assert_eq!(problem["errors"], json!([{"pointer": pointer, "detail": detail}]), "{body}");
    }
}

#[tokio::test]
async fn only_requests_for_this_host_are_served() {
    let app = TestApp::with(|config| config.allowed_hosts = vec!["plan.example".to_owned()]).await;
    for (host, status) in [("127.0.0.1:8080", 200), ("localhost", 200), ("plan.example", 200), ("evil.example", 421)] {
        let answer = app.call(Method::GET, "/v1/sessions", &[("host", host)], Body::empty()).await;
        assert_eq!(answer.status.as_u16(), status, "{host}");
    }
    let refused = app.call(Method::GET, "/", &[("host", "evil.example")], Body::empty()).await;
    refused.problem(421, "foreign-host");
}

#[tokio::test]
async fn a_request_keeps_a_harmless_id_of_the_client() {
    let app = TestApp::new().await;
    let given = app.call(Method::GET, "/nowhere", &[("x-request-id", "abc-1")], Body::empty()).await;
    assert_eq!(given.problem(404, "not-found")["request_id"], "abc-1");
    let harmful = app.call(Method::GET, "/livez", &[("x-request-id", "a b\"c")], Body::empty()).await;
    assert_ne!(harmful.header("x-request-id"), "a b\"c");
}

/// Every path and method of the OpenAPI description is routed.
#[tokio::test]
async fn the_description_and_the_router_agree() {
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

/// The service accepts the form of every body in `api/examples`.
#[tokio::test]
async fn the_examples_are_understood() {
    let app = TestApp::new().await;
    let all = examples(&app).await;
    assert!(all.len() >= 6);
    for Example { name, method, path, body, status } in all {
        let answer = app.call(method, &path, &[("content-type", "application/json")], body.to_string()).await;
        assert_eq!(u64::from(answer.status.as_u16()), status, "{name}: {answer:?}");
    }
}
