use std::time::Duration;

use axum::http::StatusCode;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{skin, skull};

#[tokio::test]
async fn a_session_begins_with_everything_missing() {
    let app = TestApp::new().await;
    let answer = app.post("/v1/sessions", json!({"label": "case 1", "settings": {"steps": 4}})).await;
    assert_eq!(answer.status, StatusCode::CREATED);
    let made = answer.json();
    let seen = app.get(answer.header("location")).await.ok();
    assert_eq!(seen, made);
    assert_eq!((&seen["label"], &seen["settings"]["steps"]), (&json!("case 1"), &json!(4)));
    for part in ["ct", "skin", "skull", "air", "target", "landmarks", "field_settings", "field", "mesh"] {
        assert_eq!(seen["parts"][part]["state"], "missing", "{part}");
    }
}

#[tokio::test]
async fn parts_show_their_state_and_bytes() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let seen = app.get(&session).await.ok();
    for (part, state) in [("skin", "ready"), ("field", "ready"), ("mesh", "missing"), ("target", "missing")] {
        assert_eq!(seen["parts"][part]["state"], state, "{part}");
    }
    assert!(seen["bytes"].as_u64().unwrap() > 500);
    app.put_json(&format!("{session}/field/settings"), json!({"spacing_mm": 1.5})).await.ok();
    assert_eq!(app.get(&session).await.ok()["parts"]["field"]["state"], "stale");
}

#[tokio::test]
async fn sessions_are_listed_in_pages() {
    let app = TestApp::new().await;
    let mut made = Vec::new();
    for _ in 0..5 {
        made.insert(0, app.session().await);
    }
    let mut listed = Vec::new();
    let mut next = Some("/v1/sessions?limit=2".to_owned());
    while let Some(path) = next {
        let page = app.get(&path).await.ok();
        let ids = page["sessions"].as_array().unwrap().iter();
        listed.extend(ids.map(|s| format!("/v1/sessions/{}", s["id"].as_str().unwrap())));
        next = page["next"].as_str().map(str::to_owned);
    }
    assert_eq!(listed, made);
}

#[tokio::test]
async fn a_deleted_session_is_gone_with_its_files() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({})).await;
    app.ended(&job).await.ok();
    let kept = app.session().await;
    app.upload(&format!("{kept}/skin"), skin()).await.ok();

    assert_eq!(app.delete(&format!("{session}?at_once=true")).await.status, StatusCode::NO_CONTENT);
    app.get(&session).await.problem(410, "gone");
    app.get(&job).await.problem(410, "gone");
    app.get(&format!("{session}/plans/{plan}")).await.problem(410, "gone");
    app.delete(&session).await.problem(410, "gone");
    assert_eq!(app.get(&kept).await.status, StatusCode::OK);
    let sessions = std::fs::read_dir(app.directory().join("blobs")).unwrap().count();
    assert_eq!(sessions, 1, "only the other session's files are left");
    app.post(&format!("{session}/restore"), json!({})).await.problem(410, "gone");
    app.post(&format!("{kept}/restore"), json!({})).await.problem(409, "wrong-state");
}

#[tokio::test]
async fn a_deleted_session_is_restored_with_its_results() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({})).await;
    app.ended(&job).await.ok();
    let frame = format!("{job}/steps/1/frame");
    let (before, bytes) = (app.get(&session).await.ok(), app.get(&frame).await.body);
    assert_eq!(app.delete(&session).await.status, StatusCode::NO_CONTENT);
    for path in [&session, &job, &frame, &format!("{session}/plans/{plan}")] {
        app.get(path).await.problem(410, "gone");
    }
    app.delete(&session).await.problem(410, "gone");
    assert_eq!(app.get("/v1/sessions").await.ok()["sessions"], json!([]));
    assert_eq!(app.get("/v1/jobs").await.ok()["jobs"], json!([]));
    let restored = app.post(&format!("{session}/restore"), json!({})).await.ok();
    assert_eq!(restored, before);
    assert_eq!(app.get(&frame).await.body, bytes);
    // A client that deletes the session again may remove it at once.
    assert_eq!(app.delete(&session).await.status, StatusCode::NO_CONTENT);
    assert_eq!(app.delete(&format!("{session}?at_once=true")).await.status, StatusCode::NO_CONTENT);
    app.post(&format!("{session}/restore"), json!({})).await.problem(410, "gone");
}

#[tokio::test]
async fn a_session_not_restored_in_time_is_deleted_for_good() {
    let app = TestApp::with(|config| config.service.deleted_retention = Duration::from_millis(50)).await;
    let session = app.session().await;
    app.upload(&format!("{session}/skin"), skin()).await.ok();
    assert_eq!(app.delete(&session).await.status, StatusCode::NO_CONTENT);
    tokio::time::sleep(Duration::from_millis(60)).await;
    app.state.service.run_maintenance().await.unwrap();
    assert_eq!(std::fs::read_dir(app.directory().join("blobs")).unwrap().count(), 0);
    app.post(&format!("{session}/restore"), json!({})).await.problem(410, "gone");
}

#[tokio::test]
async fn a_session_deleted_during_a_solve_is_restored_with_the_job_cancelled() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    assert_eq!(app.delete(&session).await.status, StatusCode::NO_CONTENT);
    app.get(&job).await.problem(410, "gone");
    app.stand_in.release();
    app.post(&format!("{session}/restore"), json!({})).await.ok();
    assert_eq!(app.ended(&job).await.json()["status"], "cancelled");
}

#[tokio::test]
async fn a_session_deleted_during_a_solve_leaves_no_files() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    assert_eq!(app.delete(&format!("{session}?at_once=true")).await.status, StatusCode::NO_CONTENT);
    // The queue continues with other jobs.
    app.stand_in.release();
    app.session_with_field().await;
    let sessions = std::fs::read_dir(app.directory().join("blobs")).unwrap().count();
    assert_eq!(sessions, 1);
}

#[tokio::test]
async fn a_session_stores_no_more_than_its_quota() {
    let app = TestApp::with(|config| config.service.session_quota = 900).await;
    let session = app.session().await;
    app.upload(&format!("{session}/skin"), skin()).await.ok();
    let mut refused = None;
    for part in ["skull", "target"] {
        let answer = app.upload(&format!("{session}/{part}"), skull()).await;
        if !answer.status.is_success() {
            refused = Some(answer);
            break;
        }
    }
    let refused = refused.expect("three surfaces are above the quota");
    assert_eq!(refused.problem(429, "quota-full")["allowed_bytes"], 900);
    assert!(app.get(&session).await.ok()["bytes"].as_u64().unwrap() <= 900);
    // A small request still works; the same upload is refused again.
    assert_eq!(app.get("/readyz").await.status, StatusCode::OK);
    let large = app.upload(&format!("{session}/target"), vec![0; 4000]).await;
    large.problem(429, "quota-full");
}

#[tokio::test]
async fn unused_sessions_expire() {
    let app = TestApp::with(|config| config.service.session_retention = Some(Duration::from_millis(300))).await;
    let session = app.session().await;
    assert!(app.get(&session).await.ok()["expires_at"].is_string());
    app.state.service.run_maintenance().await.unwrap();
    assert_eq!(app.get(&session).await.status, StatusCode::OK);
    tokio::time::sleep(Duration::from_millis(350)).await;
    app.state.service.run_maintenance().await.unwrap();
    app.get(&session).await.problem(410, "gone");
    let audit = std::fs::read_dir(app.directory().join("audit")).unwrap().next().unwrap().unwrap();
    assert!(std::fs::read_to_string(audit.path()).unwrap().contains(r#""who":"retention""#));
}

/// Rounds of maintenance at other times than those of the clock.
struct Rounds {
    app: TestApp,
    /// True time at the last round, ms since 1970.
    now_ms: i64,
}

impl Rounds {
    const DAY: u64 = 86_400;

    async fn of(retention_days: u64) -> Self {
        let app = TestApp::with(|config| {
            config.service.session_retention = Some(Duration::from_secs(retention_days * Self::DAY));
            config.service.runs_maintenance = false;
        });
        let app = app.await;
        let now_ms = app.state.service.store().look().await.unwrap().now_ms;
        Self { app, now_ms }
    }

    /// A round after `elapsed_s` of running time, with a clock that is `ahead_days` ahead.
    async fn round(&mut self, elapsed_s: u64, ahead_days: i64) {
        self.now_ms += elapsed_s as i64 * 1000;
        let service = &self.app.state.service;
        let clock_ms = self.now_ms + ahead_days * 1000 * Self::DAY as i64;
        let look = service.store().look_at(clock_ms, Duration::from_secs(elapsed_s)).await.unwrap();
        service.maintain(&look).await.unwrap();
    }

    async fn is_there(&self, session: &str) -> bool {
        self.app.get(session).await.status == StatusCode::OK
    }
}

#[tokio::test]
async fn a_clock_that_is_ahead_for_a_while_deletes_no_session() {
    let mut rounds = Rounds::of(90).await;
    let session = rounds.app.session().await;
    rounds.app.upload(&format!("{session}/skin"), skin()).await.ok();
    let hidden = rounds.app.session().await;
    assert_eq!(rounds.app.delete(&hidden).await.status, StatusCode::NO_CONTENT);
    // Seconds, hours, and once a week.
    for (elapsed_s, ahead_days) in [(5, 400), (5, 0), (600, 400), (70_000, 400), (600, 0)] {
        rounds.round(elapsed_s, ahead_days).await;
        assert!(rounds.is_there(&session).await, "{elapsed_s} s, {ahead_days} days");
    }
    // What a user deleted is restorable for a day, although the clock said that it was over.
    rounds.app.post(&format!("{hidden}/restore"), json!({})).await.ok();
    for _ in 0..4 {
        rounds.round(7 * Rounds::DAY, 0).await;
        rounds.round(5, 400).await;
        rounds.round(5, 0).await;
        assert!(rounds.is_there(&session).await);
    }
}

#[tokio::test]
async fn a_clock_that_stays_ahead_deletes_sessions_that_can_be_restored_and_come_back_with_the_clock() {
    let mut rounds = Rounds::of(90).await;
    let session = rounds.app.session().await;
    rounds.round(600, 400).await;
    rounds.round(Rounds::DAY - 600, 400).await;
    assert!(rounds.is_there(&session).await, "a day has not passed");
    rounds.round(Rounds::DAY, 400).await;
    rounds.app.get(&session).await.problem(410, "gone");
    rounds.round(Rounds::DAY / 2, 400).await;
    // The clock is right again before the time to restore is over.
    rounds.round(600, 0).await;
    assert!(rounds.is_there(&session).await);
    let audit = std::fs::read_dir(rounds.app.directory().join("audit")).unwrap().next().unwrap().unwrap();
    let log = std::fs::read_to_string(audit.path()).unwrap();
    assert!(log.contains(r#""who":"retention","what":"POST /v1/sessions/{session}/restore""#), "{log}");
}

#[tokio::test]
async fn an_unused_session_is_deleted_after_two_looks_a_day_apart_and_erased_a_day_later() {
    let mut rounds = Rounds::of(90).await;
    let session = rounds.app.session().await;
    rounds.app.upload(&format!("{session}/skin"), skin()).await.ok();
    let mut days = 0;
    while rounds.is_there(&session).await {
        for _ in 0..4 {
            rounds.round(Rounds::DAY / 4, 0).await;
        }
        days += 1;
        assert!(days <= 93, "it is still there");
    }
    assert!((91..=92).contains(&days), "{days}");
    // A user restores it, and its retention begins anew; here the clock of the rounds is ahead of the user's.
    rounds.app.post(&format!("{session}/restore"), json!({})).await.ok();
    rounds.round(600, 0).await;
    rounds.app.get(&session).await.problem(410, "gone");
    let directory = rounds.app.directory().join("blobs");
    let blobs = || std::fs::read_dir(&directory).unwrap().count();
    let stored = blobs();
    rounds.round(Rounds::DAY / 2, 0).await;
    assert!(stored > 0 && blobs() == stored);
    rounds.round(Rounds::DAY, 0).await;
    assert!(blobs() < stored);
    rounds.app.post(&format!("{session}/restore"), json!({})).await.problem(410, "gone");
}
