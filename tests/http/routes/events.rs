use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};

use prosopon_service::http::dto::JobEventLine;

use crate::support::app::TestApp;

/// Events of a finished job as lines.
async fn lines(app: &TestApp, job: &str, last: Option<&str>) -> Vec<Value> {
    let mut headers = vec![("accept", "application/x-ndjson")];
    headers.extend(last.map(|last| ("last-event-id", last)));
    let answer = app.call(Method::GET, &format!("{job}/events"), &headers, Body::empty()).await;
    assert_eq!((answer.status, answer.header("content-type")), (StatusCode::OK, "application/x-ndjson"));
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[tokio::test]
async fn events_are_numbered_and_report_every_step() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    let events = lines(&app, &job, None).await;
    let ids: Vec<u64> = events.iter().map(|e| e["id"].as_u64().unwrap()).collect();
    assert_eq!(ids, (1..=events.len() as u64).collect::<Vec<_>>());
    // Every line is what the OpenAPI document describes, and has nothing else.
    for event in &events {
        let typed: JobEventLine = serde_json::from_value(event.clone()).unwrap();
        assert_eq!(serde_json::to_value(typed).unwrap(), *event);
    }
    let names: Vec<&str> = events.iter().map(|e| e["event"].as_str().unwrap()).filter(|e| *e != "progress").collect();
    assert_eq!(names, ["status", "status", "step", "step", "step", "warning", "end"]);
    assert_eq!(
        events[events.len() - 2]["data"],
        json!({"code": "stand-in", "severity": "check", "message": "a stand-in"})
    );
    let step = &events.iter().find(|e| e["event"] == "step").unwrap()["data"];
    assert_eq!((&step["k"], &step["steps"], &step["converged"]), (&json!(1), &json!(3), &json!(true)));
    assert_eq!(step["links"]["skin"], format!("{job}/steps/1/skin"));
    let end = &events.last().unwrap()["data"];
    assert_eq!((&end["status"], &end["links"]["report"]), (&json!("succeeded"), &json!(format!("{job}/report"))));
}

#[tokio::test]
async fn last_event_id_replays_only_later_events() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({})).await;
    let all = lines(&app, &job, None).await;
    assert_eq!(lines(&app, &job, Some("3")).await, all[3..]);
    let last = all.len().to_string();
    let headers = [("last-event-id", last.as_str())];
    let answer = app.call(Method::GET, &format!("{job}/events"), &headers, Body::empty()).await;
    assert_eq!(answer.status, StatusCode::NO_CONTENT);
    let faulty = app.call(Method::GET, &format!("{job}/events"), &[("last-event-id", "x")], Body::empty()).await;
    faulty.problem(400, "malformed-request");
}

#[tokio::test]
async fn server_sent_events_equal_the_lines() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    // The stream opens while the job runs and ends with it.
    let path = format!("{job}/events");
    let release = async {
        tokio::time::sleep(std::time::Duration::from_millis(30)).await;
        app.stand_in.release();
    };
    let (answer, ()) = tokio::join!(app.get(&path), release);
    assert_eq!(answer.header("content-type"), "text/event-stream");
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    let blocks: Vec<&str> = text.split("\n\n").filter(|b| b.contains("event: ")).collect();
    let expected = lines(&app, &job, None).await;
    assert_eq!(blocks.len(), expected.len());
    for (block, event) in blocks.iter().zip(expected) {
        assert!(block.contains(&format!("id: {}\n", event["id"])), "{block}");
        assert!(block.contains(&format!("event: {}\n", event["event"].as_str().unwrap())), "{block}");
        let data = block.lines().find_map(|l| l.strip_prefix("data: ")).unwrap();
        assert_eq!(serde_json::from_str::<Value>(data).unwrap(), event["data"]);
    }
}

#[tokio::test]
async fn the_end_of_a_failed_job_has_its_problem() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.fails_after.store(1, std::sync::atomic::Ordering::SeqCst);
    let job = app.solve(&session, &plan, json!({})).await;
    let end = lines(&app, &job, None).await.pop().unwrap();
    assert_eq!(end["data"]["problem"]["type"], "/problems/solver-not-converged");
    assert_eq!(end["data"]["status"], "failed");
}

#[tokio::test]
async fn the_stream_of_a_deleted_job_ends_as_cancelled() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    let delete = async {
        tokio::time::sleep(std::time::Duration::from_millis(30)).await;
        assert_eq!(app.delete(&format!("{session}?at_once=true")).await.status, StatusCode::NO_CONTENT);
    };
    let (received, ()) = tokio::join!(lines(&app, &job, None), delete);
    let [.., before, end] = received.as_slice() else { panic!("{received:?}") };
    assert_eq!((&end["event"], &end["data"]["status"]), (&json!("end"), &json!("cancelled")));
    assert_eq!(end["data"]["problem"]["type"], "/problems/gone");
    assert!(end["id"].as_u64() > before["id"].as_u64());
    app.get(&format!("{job}/events")).await.problem(410, "gone");
}

#[tokio::test]
async fn a_client_whose_events_expired_receives_resync() {
    let app = TestApp::with(|config| config.service.event_retention = Duration::ZERO).await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    app.ended(&job).await.ok();
    let all = lines(&app, &job, Some("0")).await;
    let newest = all.last().unwrap()["id"].as_u64().unwrap();
    // An event id that does not exist yet: all events are sent again.
    let other_life = lines(&app, &job, Some("100000")).await;
    assert_eq!((&other_life[0]["event"], other_life.len()), (&json!("resync"), all.len() + 1));

    tokio::time::sleep(Duration::from_millis(5)).await;
    app.state.service.run_maintenance().await.unwrap();
    let app = app.restart().await;
    let left = lines(&app, &job, Some("2")).await;
    let names: Vec<&str> = left.iter().map(|e| e["event"].as_str().unwrap()).collect();
    assert_eq!(names, ["resync", "end"]);
    assert_eq!((left[0]["id"].as_u64(), left[1]["id"].as_u64()), (Some(newest - 1), Some(newest)));
    assert_eq!(left[0]["data"]["links"]["self"], job);
    assert_eq!(
        lines(&app, &job, Some((newest - 1).to_string().as_str())).await.len(),
        1,
        "who has all but the last needs no resync"
    );
}

#[tokio::test]
async fn a_silent_stream_sends_heartbeats() {
    let app = TestApp::with(|config| config.limits.heartbeat = Duration::from_millis(20)).await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({"steps": 2})).await;
    app.until_step(&job, 1).await;
    let release = async {
        tokio::time::sleep(Duration::from_millis(150)).await;
        app.stand_in.release();
    };
    let (path, none) = (format!("{job}/events"), [("accept", "text/event-stream")]);
    let stream = app.call(Method::GET, &path, &none, Body::empty());
    let (received, stream, ()) = tokio::join!(lines(&app, &job, Some("0")), stream, release);
    assert!(received.iter().any(|line| line["event"] == "heartbeat"));
    let text = String::from_utf8(stream.body.to_vec()).unwrap();
    let retry: u64 = text.lines().next().unwrap().strip_prefix("retry: ").unwrap().parse().unwrap();
    assert!((1500..3000).contains(&retry), "{retry}");
    assert!(text.lines().any(|line| line.starts_with(':')));
}
