//! The real binary with its rows in Postgres and its files in a bucket.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::binary::{Server, serve};
use crate::engines::{Bucket, Cluster};
use crate::shapes::skin;

fn start(data: &Path, database: &str, bucket: &Bucket) -> Server {
    let mut command = serve(data, "127.0.0.1:0");
    command.env("PROSOPON_DATABASE", database).env("PROSOPON_BLOBS", bucket.url()).envs(bucket.environment());
    Server::spawn(command)
}

fn prosopon(arguments: &[&str]) -> (bool, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_prosopon")).args(arguments).output().unwrap();
    (done.status.success(), String::from_utf8([done.stdout, done.stderr].concat()).unwrap())
}

/// Waits for the end of a job, also while the service cannot say how it stands.
fn finished(server: &Server, job: &Value) -> Value {
    loop {
        let view = server.get(&format!("/v1/jobs/{}?wait_s=5", job["id"].as_str().unwrap())).json();
        match view["status"].as_str() {
            Some("accepted" | "running") => {}
            None if view["type"] == "/problems/store-unavailable" => {}
            _ => return view,
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_database_and_a_bucket_keep_everything_and_may_be_away_for_a_while() {
    let bucket = Bucket::start().await;
    let mut cluster = Cluster::start();
    let database = cluster.fresh_database().await;
    // The bucket is served by the other thread.
    tokio::task::block_in_place(move || {
        let data = tempfile::tempdir().unwrap();
        let (fine, told) = prosopon(&["migrate", "--database", &database]);
        assert!(fine && told.contains("had format 0") && !told.contains("ecret"), "{told}");
        let server = start(data.path(), &database, &bucket);
        let session = server.session();
        server.upload(&format!("{session}/skin"), &skin()).ok();
        let stored = server.get(&format!("{session}/skin?format=stl")).body;

        let field = server.session_with_field();
        let (osteotomy, _) = server.cut(&field);
        let mesh = server.post(&format!("{field}/mesh"), &json!({ "osteotomy": osteotomy, "edge_mm": 8.0 })).ok();
        cluster.restart();
        let meshed = finished(&server, &mesh);
        assert_eq!(meshed["status"], "succeeded", "{meshed}");
        let before = server.get(&session).ok();
        assert!(!data.path().join("prosopon.sqlite").exists() && !data.path().join("blobs").exists());
        let directory = data.path().to_str().unwrap();
        let (backed, told) = prosopon(&["backup", "--data", directory, "--out", "never"]);
        assert!(!backed && told.contains("Postgres"), "{told}");
        drop(server);
        let (whole, told) = prosopon(&["audit", "verify", "--data", directory, "--database", &database]);
        assert!(whole, "{told}");

        // Nothing that matters was in the directory.
        let elsewhere = tempfile::tempdir().unwrap();
        let server = start(elsewhere.path(), &database, &bucket);
        assert_eq!(server.get(&session).ok(), before);
        assert_eq!(server.get(&format!("{session}/skin?format=stl")).body, stored);
        assert_eq!(finished(&server, &mesh), meshed);

        drop(cluster);
        while server.get(&session).status == 200 {}
        server.get(&session).refused(503, "store-unavailable", "try again");
        server.get("/readyz").refused(503, "store-unavailable", "try again");
        assert_eq!(server.get("/livez").status, 200);
    });
}
