use std::sync::atomic::Ordering;

use prosopon_store::{Store, StoreError};
use serde_json::json;

use crate::support::app::TestApp;

#[tokio::test]
async fn everything_is_there_after_a_restart() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, json!({})).await;
    app.ended(&job).await.ok();
    let paths = [
        session.clone(),
        job.clone(),
        format!("{job}/report"),
        format!("{session}/field"),
        format!("{session}/mesh"),
        format!("{session}/plans/{plan}"),
        format!("{job}/steps/6/frame"),
        format!("{job}/steps/6/skin"),
        format!("{job}/topology"),
    ];
    let mut before = Vec::new();
    for path in &paths {
        before.push(app.get(path).await.body);
    }
    let app = app.restart().await;
    for (path, before) in paths.iter().zip(before) {
        assert_eq!(app.get(path).await.body, before, "{path}");
    }
    // The session remains usable: the stored mesh still matches these inputs.
    let job = app.solve(&session, &plan, json!({})).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
}

#[tokio::test]
async fn a_job_interrupted_by_a_stop_runs_again_and_its_steps_stay_the_same() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(2);
    let job = app.solve(&session, &plan, json!({"steps": 4})).await;
    app.until_step(&job, 2).await;
    let step = app.get(&format!("{job}/steps/2/frame")).await;
    let app = app.restart().await;
    let ended = app.ended(&job).await.ok();
    assert_eq!((&ended["status"], &ended["step"]), (&json!("succeeded"), &json!(4)));
    assert_eq!(ended["attempt"], 1, "a stop in good order is no failed attempt");
    let again = app.get(&format!("{job}/steps/2/frame")).await;
    assert_eq!((again.body, again.headers["etag"].clone()), (step.body, step.headers["etag"].clone()));
    assert_eq!(app.stand_in.solves.load(Ordering::SeqCst), 2);
    let events = String::from_utf8(app.get(&format!("{job}/events")).await.body.to_vec()).unwrap();
    assert!(events.contains(r#""status":"interrupted""#));
}

#[tokio::test]
async fn a_job_that_the_service_did_not_survive_is_given_up_after_two_attempts() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let job = app.solve(&session, &plan, json!({})).await;
    app.until_step(&job, 1).await;
    let app = mark_as_crashed(app, &job, 1).await;
    assert_eq!(app.ended(&job).await.ok()["attempt"], 2, "the second attempt is made");
    let app = mark_as_crashed(app, &job, 2).await;
    let ended = app.get(&job).await.ok();
    assert_eq!((&ended["status"], &ended["problem"]["type"]), (&json!("failed"), &json!("/problems/job-interrupted")));
    assert_eq!((&ended["problem"]["job_status"], &ended["problem"]["attempts"]), (&json!("failed"), &json!(2)));
    assert_eq!(app.get(&format!("{job}/steps/1/frame")).await.status, 200);
}

/// Restarts on a database as a killed process leaves it: the job is running in its `attempt`th attempt.
async fn mark_as_crashed(app: TestApp, job: &str, attempt: u32) -> TestApp {
    let id = job.rsplit('/').next().unwrap().to_owned();
    app.restart_after(async move |directory| {
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(directory.join("prosopon.sqlite"));
        let pool = sqlx::SqlitePool::connect_with(options).await.unwrap();
        sqlx::query("UPDATE jobs SET state = 'running', attempt = ?, fault = NULL WHERE id = ?")
            .bind(attempt)
            .bind(id)
            .execute(&pool)
            .await
            .unwrap();
        pool.close().await;
    })
    .await
}

#[tokio::test]
async fn files_without_a_row_are_swept_at_start() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    let id = session.rsplit('/').next().unwrap().to_owned();
    let orphan = app.directory().join("blobs").join(&id).join("left-behind#1");
    std::fs::write(&orphan, b"half").unwrap();
    let app = app.restart().await;
    assert!(!orphan.exists());
    assert_eq!(app.get(&format!("{session}/skin")).await.status, 200);
}

#[tokio::test]
async fn a_directory_in_use_is_refused() {
    let app = TestApp::new().await;
    assert!(matches!(Store::open(app.directory()).await, Err(StoreError::InUse)));
}
