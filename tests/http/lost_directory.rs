//! A data directory that is moved or deleted under the service.

use std::time::Duration;

use serde_json::json;

use crate::support::app::TestApp;
use crate::support::binary::Server;
use crate::support::shapes::{skin, skull as skull_file};

#[tokio::test]
async fn what_is_lost_is_not_acknowledged() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let skull = format!("{session}/skull");
    app.upload(&skull, skull_file()).await.ok();
    let stored = app.get(&skull).await.body;
    let aside = app.directory().with_extension("aside");
    let lock = || app.directory().join("lock");
    for made_again in [false, true] {
        std::fs::rename(app.directory(), &aside).unwrap();
        if made_again {
            // As a second service would.
            std::fs::create_dir(app.directory()).unwrap();
            std::fs::write(lock(), []).unwrap();
        }
        let refused = app.post("/v1/sessions", json!({})).await.problem(503, "store-unavailable");
        assert!(refused["detail"].as_str().unwrap().contains("data directory"), "{refused}");
        app.get("/readyz").await.problem(503, "store-unavailable");
        app.upload(&skull, skin()).await.problem(503, "store-unavailable");
        let read = app.get(&session).await;
        assert!(read.status == 200 || read.status == 503, "{read:?}");
        if made_again {
            std::fs::remove_dir_all(app.directory()).unwrap();
        }
        assert!(!app.directory().exists(), "nothing makes the directory anew");
        std::fs::rename(&aside, app.directory()).unwrap();
        assert_eq!(app.get(&skull).await.body, stored, "a refused upload replaces nothing");
        app.post("/v1/sessions", json!({})).await.ok();
        assert_eq!(app.get("/readyz").await.status, 200);
    }
}

#[tokio::test]
async fn a_lost_part_of_the_directory_is_noticed() {
    for part in ["prosopon.sqlite", "blobs", "lock"] {
        let app = TestApp::new().await;
        std::fs::rename(app.directory().join(part), app.directory().join("aside")).unwrap();
        app.post("/v1/sessions", json!({})).await.problem(503, "store-unavailable");
        app.get("/readyz").await.problem(503, "store-unavailable");
    }
}

#[test]
fn a_service_without_its_directory_ends() {
    let outer = tempfile::tempdir().unwrap();
    let data = outer.path().join("data");
    let server = Server::start(&data, &[]);
    server.session();
    std::fs::rename(&data, outer.path().join("aside")).unwrap();
    let ended = server.end_within(Duration::from_secs(60));
    assert!(ended.is_some_and(|status| !status.success()), "{ended:?}");
    // Nothing is lost: the directory is opened where it is now.
    let server = Server::start(&outer.path().join("aside"), &[]);
    assert_eq!(server.get("/v1/sessions").ok()["sessions"].as_array().unwrap().len(), 1);
}
