//! Requests that are malformed, stalled or too large.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::binary::{Server, serve};
use crate::support::shapes::{nifti, skin};

const GIGABYTE: u64 = 1 << 30;

#[tokio::test]
async fn malformed_requests_are_answered_with_problems() {
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
async fn an_unreadable_parameter_is_refused_with_its_pointer() {
    let app = TestApp::new().await;
    let slice = format!("{}/field/slice.png", app.session().await);
    for (path, name, detail) in [
        ("/v1/sessions?limit=many", "/limit", "expected a whole number within range"),
        ("/v1/sessions?colour=red", "/colour", "unknown parameter `colour`, allowed are `before`, `limit`"),
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
async fn invalid_values_are_refused_with_what_was_expected() {
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

/// A name of a megabyte comes back shortened.
#[tokio::test]
async fn problems_are_short_whatever_the_request_says() {
    let app = TestApp::new().await;
    for name in ["[".repeat(1 << 20), "é".repeat(1 << 19)] {
        let body = json!({ name: 1 }).to_string();
        let answer = app.call(Method::POST, "/v1/sessions", &[("content-type", "application/json")], body).await;
        assert!(answer.status.is_client_error() && answer.body.len() < 3000, "{} bytes", answer.body.len());
    }
}

#[tokio::test]
async fn a_valid_request_id_of_the_client_is_kept() {
    let app = TestApp::new().await;
    let given = app.call(Method::GET, "/nowhere", &[("x-request-id", "abc-1")], Body::empty()).await;
    assert_eq!(given.problem(404, "not-found")["request_id"], "abc-1");
    let harmful = app.call(Method::GET, "/livez", &[("x-request-id", "a b\"c")], Body::empty()).await;
    assert_ne!(harmful.header("x-request-id"), "a b\"c");
}

/// Sends bytes on a connection of their own; returns the answer until the connection ends.
fn answer_to(server: &Server, request: &[u8]) -> String {
    let mut socket = TcpStream::connect(server.address()).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    socket.write_all(request).ok();
    let mut answer = Vec::new();
    socket.read_to_end(&mut answer).ok();
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn a_request_has_one_host_and_a_refused_upload_ends_its_connection() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::spawn(serve(directory.path(), "127.0.0.1:0"));
    let get =
        |hosts: &str| answer_to(&server, format!("GET /livez HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n").as_bytes());
    assert!(get("Host: localhost\r\n").starts_with("HTTP/1.1 200"));
    for hosts in ["", "Host: localhost\r\nHost: localhost\r\n"] {
        assert!(get(hosts).starts_with("HTTP/1.1 400"), "{hosts}");
    }
    assert!(answer_to(&server, b"GET /livez HTTP/1.0\r\n\r\n").starts_with("HTTP/1.0 200"));
    let trace = answer_to(&server, b"TRACE /v1/sessions HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    assert!(trace.starts_with("HTTP/1.1 405"), "{trace}");
    let unknown = uuid::Uuid::nil();
    let upload =
        format!("PUT /v1/sessions/{unknown}/skin HTTP/1.1\r\nHost: localhost\r\nContent-Length: 90000000\r\n\r\nsolid");
    let refused = answer_to(&server, upload.as_bytes());
    assert!(refused.starts_with("HTTP/1.1 404") && refused.contains("\r\nconnection: close\r\n"), "{refused}");
    // The same of a client that sends nothing before it is asked to.
    let waiting = upload.replace("\r\n\r\nsolid", "\r\nExpect: 100-continue\r\n\r\n");
    let refused = answer_to(&server, waiting.as_bytes());
    assert!(refused.starts_with("HTTP/1.1 404") && !refused.contains("100 Continue"), "{refused}");
    // A client that sends everything before it reads gets the reason too, before any handler is asked.
    let session = server.session();
    let mut whole = format!("PUT {session}/skin?colour=red HTTP/1.1\r\nHost: localhost\r\n").into_bytes();
    whole.extend(b"Content-Length: 30000000\r\n\r\n");
    whole.resize(whole.len() + 30_000_000, 0);
    let refused = answer_to(&server, &whole);
    assert!(refused.starts_with("HTTP/1.1 400") && refused.contains("colour"), "{refused}");
}

#[test]
fn slow_and_huge_heads_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let mut command = serve(directory.path(), "127.0.0.1:0");
    command.env("PROSOPON_HEADER_TIMEOUT_S", "1");
    let server = Server::spawn(command);
    let answer_to = |request: &[u8]| answer_to(&server, request).lines().next().unwrap_or_default().to_owned();
    let begun = Instant::now();
    let slow = answer_to(b"GET /livez HTTP/1.1\r\nHost: localh");
    assert!(slow.is_empty() || slow.contains("408"), "{slow}");
    assert!(begun.elapsed() < Duration::from_secs(15), "{:?}", begun.elapsed());
    let huge = format!("GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Long: {}\r\n\r\n", "x".repeat(200_000));
    assert!(answer_to(huge.as_bytes()).contains("431"));
    let many = format!("GET /livez HTTP/1.1\r\nHost: localhost\r\n{}\r\n", "X-A: b\r\n".repeat(500));
    assert!(answer_to(many.as_bytes()).contains("431"));
    assert_eq!(server.get("/livez").status, 200);
}

#[tokio::test]
async fn a_stalled_body_times_out() {
    let app = TestApp::with(|config| {
        config.limits.body = Duration::from_millis(50);
        config.limits.upload_idle = Duration::from_millis(50);
    })
    .await;
    let session = app.session().await;
    let never = || {
        let begin = futures::stream::once(async { Ok::<_, std::io::Error>(Bytes::from_static(b"{")) });
        Body::from_stream(futures::StreamExt::chain(begin, futures::stream::pending()))
    };
    let headers = [("content-type", "application/json")];
    app.call(Method::POST, "/v1/sessions", &headers, never()).await.problem(408, "timeout");
    app.call(Method::PUT, &format!("{session}/skin"), &[], never()).await.problem(408, "timeout");
}

#[test]
fn three_gigabytes_are_refused_without_memory_or_disk() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &["--max-surface-mb", "256", "--max-ct-mb", "256"]);
    let session = server.session();
    server.upload(&format!("{session}/skin"), &skin()).ok();
    let (files, memory) = (bytes_below(directory.path()), peak_memory(&server));
    // Zeros are not a CT and would be refused at once; this file is a CT with 432 MB of voxels.
    let mut header = nifti()[..352].to_vec();
    for at in [42, 44, 46] {
        header[at..at + 2].copy_from_slice(&600i16.to_le_bytes());
    }
    for (part, beginning) in [("skin", Vec::new()), ("ct", header)] {
        for chunked in [false, true] {
            let answer = upload_endlessly(&server, &format!("{session}/{part}"), &beginning, chunked);
            assert!(answer.starts_with("HTTP/1.1 413 ") && answer.contains("application/problem+json"), "{answer}");
            assert!(answer.contains("/problems/too-large") && answer.contains("268435456"), "{answer}");
        }
    }
    assert!(peak_memory(&server) < memory + 100 * (1 << 20), "{memory} then {}", peak_memory(&server));
    // The journal and the shared memory of the database may have grown.
    assert!(bytes_below(&directory.path().join("blobs")) < 10_000 && bytes_below(directory.path()) < files + (1 << 20));
    assert_eq!(server.get("/readyz").status, 200);
    server.upload(&format!("{session}/skin"), &skin()).ok();
}

/// Sends `beginning` and then zeros, up to three gigabytes, until the service answers; returns the answer.
fn upload_endlessly(server: &Server, path: &str, beginning: &[u8], chunked: bool) -> String {
    let mut socket = TcpStream::connect(server.address()).unwrap();
    socket.set_write_timeout(Some(Duration::from_secs(60))).unwrap();
    let framing =
        if chunked { "Transfer-Encoding: chunked".to_owned() } else { format!("Content-Length: {}", 3 * GIGABYTE) };
    let head = format!("PUT {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{framing}\r\n\r\n");
    socket.write_all(head.as_bytes()).unwrap();
    let answered = AtomicBool::new(false);
    let mut reader = socket.try_clone().unwrap();
    std::thread::scope(|scope| {
        let answer = scope.spawn(|| {
            reader.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            let (mut answer, mut piece) = (String::new(), [0; 4096]);
            // Read to the end of the problem: the connection may stay open while the service discards the rest.
            while !answer.ends_with('}') {
                match reader.read(&mut piece) {
                    Ok(n) if n > 0 => answer.push_str(&String::from_utf8_lossy(&piece[..n])),
                    _ => break,
                }
            }
            answered.store(true, Ordering::SeqCst);
            answer
        });
        let mut next = beginning.to_vec();
        next.resize(1 << 20, 0);
        let mut sent = 0;
        while sent < 3 * GIGABYTE && !answered.load(Ordering::SeqCst) {
            let size = format!("{:x}\r\n", next.len());
            let pieces: &[&[u8]] = if chunked { &[size.as_bytes(), &next, b"\r\n"] } else { &[&next] };
            if pieces.iter().any(|piece| socket.write_all(piece).is_err()) {
                break;
            }
            sent += next.len() as u64;
            next.fill(0);
        }
        answer.join().unwrap()
    })
}

fn bytes_below(path: &Path) -> u64 {
    let below =
        |e: std::fs::DirEntry| if e.path().is_dir() { bytes_below(&e.path()) } else { e.metadata().unwrap().len() };
    std::fs::read_dir(path).map(|d| d.map(|e| below(e.unwrap())).sum()).unwrap_or(0)
}

/// Peak resident memory, bytes; 0 where the system does not report it.
fn peak_memory(server: &Server) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", server.child.id())).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap_or(0) * 1024
}

/// A misspelt parameter would be left out in silence.
#[tokio::test]
async fn unknown_query_parameters_are_refused_by_every_route() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let nil = "00000000-0000-0000-0000-000000000000";
    let api: Value = serde_json::from_str(include_str!("../../api/openapi.json")).unwrap();
    for (path, item) in api["paths"].as_object().unwrap().iter().filter(|(path, _)| path.starts_with("/v1/")) {
        let path = path.replace("/v1/sessions/{session}", &session).replace("{k}", "1").replace("{segment}", "1");
        let path = ["{job}", "{osteotomy}", "{plan}"].iter().fold(path, |path, id| path.replace(id, nil));
        // An unknown job is not found before its query is read.
        for method in
            item.as_object().unwrap().keys().filter(|_| !path.contains("/v1/jobs/") && !path.contains("compare/"))
        {
            let method = method.to_uppercase().parse().unwrap();
            let refused = app.call(method, &format!("{path}?fromat=ply"), &[], Body::empty()).await;
            let problem = refused.problem(400, "malformed-request");
            assert_eq!(problem["errors"][0]["pointer"], "/fromat", "{path}: {problem}");
        }
    }
    assert_eq!(app.get(&session).await.status, StatusCode::OK);
}
