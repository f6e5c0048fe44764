//! Signed links: one GET for some minutes, without a token.

use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, StatusCode};
use prosopon_service::http::auth::{Access, ApiKey, Scope};
use prosopon_store::{Audit, sha256_hex};
use serde_json::{Value, json};

use crate::security::{call, two_tenants};
use crate::support::app::pointers;
use crate::support::shapes::skin;

#[tokio::test]
async fn a_link_reads_its_one_answer_without_a_token() {
    let (app, a, b) = two_tenants().await;
    let made = call(&app, &a, Method::POST, "/v1/sessions", json!({"label": "secret"})).await;
    let session = made.header("location").to_owned();
    let (owner, length) = (format!("Bearer {a}"), skin().len().to_string());
    let headers = [("authorization", owner.as_str()), ("content-length", length.as_str())];
    app.call(Method::PUT, &format!("{session}/skin"), &headers, skin()).await.ok();

    let path = format!("{session}/skin?format=stl");
    let link = call(&app, &a, Method::POST, "/v1/links", json!({"path": path})).await;
    assert_eq!(link.status, StatusCode::CREATED);
    let url = link.json()["url"].as_str().unwrap().to_owned();
    let by_token = call(&app, &a, Method::GET, &path, Value::Null).await;
    let by_link = app.get(&url).await;
    assert_eq!((by_link.status, &by_link.body), (StatusCode::OK, &by_token.body));
    // Pages of other origins can show it in an image; nothing else of the service.
    assert_eq!(by_link.header("cross-origin-resource-policy"), "cross-origin");
    assert_eq!(by_token.header("cross-origin-resource-policy"), "same-origin");
    assert_eq!(app.call(Method::HEAD, &url, &[], Body::empty()).await.status, StatusCode::OK);

    // Another path, query, time or signature, and everything but a GET, are refused.
    for changed in [
        url.replace("/skin?", "/skull?"),
        url.replace("format=stl", "format=ply"),
        url.replace("link=1", "link=2"),
        url.replace(&session, "/v1/sessions/00000000-0000-0000-0000-000000000000"),
        format!("{}A", &url[..url.len() - 2]),
        path.clone(),
    ] {
        app.get(&changed).await.problem(401, "unauthenticated");
    }
    app.call(Method::PUT, &url, &[("content-length", "0")], Body::empty()).await.problem(403, "forbidden");
    assert_eq!(call(&app, &a, Method::GET, &session, Value::Null).await.ok()["label"], "secret");

    // Of another tenant no link can be made, and nobody without a token makes one.
    let foreign = call(&app, &b, Method::POST, "/v1/links", json!({"path": path})).await;
    assert_eq!(pointers(&foreign), ["/path"]);
    app.post("/v1/links", json!({"path": path})).await.problem(401, "unauthenticated");

    let entries = || Audit::verify(app.directory(), None).unwrap().entries;
    assert!(entries() > 5);
    let file = std::fs::read_dir(app.directory().join("audit")).unwrap().next().unwrap().unwrap().path();
    let log = std::fs::read_to_string(file).unwrap();
    let name: String = url.rsplit('.').next().unwrap().chars().take(12).collect();
    let id = session.rsplit('/').next().unwrap();
    let made = log.lines().find(|line| line.contains("POST /v1/links link ")).unwrap();
    assert!(made.contains(&name) && made.contains(id) && made.contains("front-a"), "{made}");
    assert!(log.lines().any(|line| line.contains(&format!("link:{name}")) && line.contains("GET")), "{log}");
    assert!(!log.contains(url.rsplit('.').next().unwrap()));

    let deleted = call(&app, &a, Method::DELETE, &session, Value::Null).await;
    assert_eq!(deleted.status, StatusCode::NO_CONTENT);
    app.get(&url).await.problem(410, "gone");

    // Links end with the key that made them, also where it stays with another tenant or without the scope.
    let Access::Tokens(authenticator) = &app.state.access else { panic!("the service has keys") };
    let key = |tenant: &str, scope: Scope| ApiKey {
        id: "front-a".to_owned(),
        tenant: tenant.parse().unwrap(),
        scopes: [scope].into_iter().collect(),
        hash: format!("sha256:{}", sha256_hex(a.as_bytes())),
    };
    for (keys, status) in [
        (vec![key("a", Scope::Read)], 410),
        (vec![key("b", Scope::Read)], 401),
        (vec![key("a", Scope::Write)], 401),
        (Vec::new(), 401),
    ] {
        authenticator.set_keys(keys);
        assert_eq!(app.get(&url).await.status.as_u16(), status);
    }
    let refused = app.get(&url).await.problem(401, "unauthenticated");
    assert!(
        refused["detail"].as_str().unwrap().contains("the key that made the link was removed or changed"),
        "{refused}"
    );
}

#[tokio::test]
async fn a_link_ends_and_its_request_is_checked() {
    let (app, a, _) = two_tenants().await;
    let made = call(&app, &a, Method::POST, "/v1/sessions", json!({})).await;
    let session = made.header("location").to_owned();
    let short = call(&app, &a, Method::POST, "/v1/links", json!({"path": session, "valid_s": 1})).await.json();
    let url = short["url"].as_str().unwrap();
    assert_eq!(app.get(url).await.status, StatusCode::OK);
    tokio::time::sleep(Duration::from_millis(2100)).await;
    let detail = app.get(url).await.problem(401, "unauthenticated")["detail"].to_string();
    assert!(detail.contains("expired"), "{detail}");
    for (request, faults) in [
        (json!({"path": "/v1/sessions", "valid_s": 0}), vec!["/valid_s", "/path"]),
        (json!({"path": format!("http://elsewhere{session}")}), vec!["/path"]),
        (json!({"path": format!("{session}?link=1.x")}), vec!["/path"]),
    ] {
        assert_eq!(pointers(&call(&app, &a, Method::POST, "/v1/links", request).await), faults);
    }
}

/// The service's other processes and its next start know the same links.
#[tokio::test]
async fn links_outlive_the_process() {
    let app = crate::support::app::TestApp::new().await;
    let session = app.session().await;
    let link = app.post("/v1/links", json!({"path": session, "valid_s": 3600})).await;
    let url = link.json()["url"].as_str().unwrap().to_owned();
    let app = app.restart().await;
    assert_eq!(app.get(&url).await.status, StatusCode::OK);
}
