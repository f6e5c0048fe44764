//! Fields and meshes that are stored so that they need not be built again.

use std::sync::atomic::Ordering;

use futures::future::join_all;
use prosopon_store::{PartKind, PartRecord, SessionId};
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, stl};

async fn field(app: &TestApp, session: &str) -> PartRecord {
    let id: SessionId = session.rsplit('/').next().unwrap().parse().unwrap();
    app.state.service.store().part(id, PartKind::Field).await.unwrap().unwrap()
}

#[tokio::test]
async fn a_stored_field_counts_in_no_quota_and_is_left_out_where_room_is_low() {
    let app = TestApp::with(|config| config.service.session_quota = 100_000).await;
    app.stand_in.kept_bytes.store(1_000_000, Ordering::SeqCst);
    let session = app.session_with_field().await;
    let part = field(&app, &session).await;
    assert!(part.blob.is_some() && part.bytes < 10_000, "{part:?}");

    // Half of what is free is above the limit, but not by much.
    let free = app.state.service.store().free_room().unwrap().unwrap().bytes;
    let app = TestApp::with(|config| config.service.min_free = free / 2).await;
    app.stand_in.kept_bytes.store(1_000_000, Ordering::SeqCst);
    let session = app.session_with_field().await;
    assert_eq!(field(&app, &session).await.blob, None);
}

#[tokio::test]
async fn many_readers_after_a_restart_read_a_stored_field_once() {
    let app = TestApp::new().await;
    app.stand_in.kept_bytes.store(1_000_000, Ordering::SeqCst);
    let session = app.session_with_field().await;
    let app = app.restart().await;
    let points = json!({"points_mm": [[0, 0, 0]], "solid": "bone"});
    let path = format!("{session}/field/query");
    for answer in join_all((0..16).map(|_| app.post(&path, points.clone()))).await {
        answer.ok();
    }
    assert_eq!(app.stand_in.recalled.load(Ordering::SeqCst), 1);
    // Of other surfaces nothing is stored.
    app.upload(&format!("{session}/skin"), stl(&cube([0.0; 3], 95.0))).await;
    app.post(&path, points).await.problem(409, "stale");
    assert_eq!(app.stand_in.recalled.load(Ordering::SeqCst), 1);
}
