//! Several processes of the real binary with one Postgres database and one bucket.

use std::process::Command;
use std::time::Duration;

use prosopon_formats::export;
use prosopon_planning::phantom;
use serde_json::{Value, json};

use crate::engines::{Bucket, Cluster, fresh_database};
use crate::support::binary::Server;
use crate::support::processes::{Rows, finished, planned, signal, solve_demo_plan, start};
use crate::support::shapes::skin;

fn prosopon(arguments: &[&str]) -> (bool, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_prosopon")).args(arguments).output().unwrap();
    (done.status.success(), String::from_utf8([done.stdout, done.stderr].concat()).unwrap())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn everything_is_stored_in_the_database_and_the_bucket() {
    let bucket = Bucket::start().await;
    let mut cluster = Cluster::start();
    let database = cluster.fresh_database().await;
    // The other thread serves the bucket.
    tokio::task::block_in_place(move || {
        let data = tempfile::tempdir().unwrap();
        let (fine, output) = prosopon(&["migrate", "--database", &database]);
        assert!(fine && output.contains("found format 0") && !output.contains("ecret"), "{output}");
        let server = start("serve", data.path(), &database, &bucket);
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
        let (backed, output) = prosopon(&["backup", "--data", directory, "--out", "never"]);
        assert!(!backed && output.contains("Postgres"), "{output}");
        drop(server);
        let (whole, output) = prosopon(&["audit", "verify", "--data", directory, "--database", &database]);
        assert!(whole, "{output}");

        // No required data were in the directory.
        let elsewhere = tempfile::tempdir().unwrap();
        let server = start("serve", elsewhere.path(), &database, &bucket);
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

fn frames(server: &Server, job: &Value) -> Vec<Vec<u8>> {
    let path = |k| format!("/v1/jobs/{}/steps/{k}/frame", job["id"].as_str().unwrap());
    (1..=16).map(|k| server.get(&path(k)).body).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn another_worker_resumes_a_job_of_a_killed_or_halted_one() {
    let bucket = Bucket::start().await;
    let database = fresh_database().await;
    tokio::task::block_in_place(move || {
        let [api_data, first_data, second_data, alone] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let api = start("serve --no-worker", api_data.path(), &database, &bucket);
        let first = start("worker", first_data.path(), &database, &bucket);
        let job = solve_demo_plan(&api);
        let events = format!("/v1/jobs/{}/events", job["id"].as_str().unwrap());
        // A client of one process follows what another computes.
        let mut stream = api.stream(&events);
        while stream.next_event()["event"] != "step" {}
        let second = start("worker", second_data.path(), &database, &bucket);
        // Wait for the first checkpoint.
        let (mut rows, at_hand) = (Rows::open(&database), "SELECT count(milestone_blob) FROM jobs");
        while rows.count(at_hand) == 0 {}
        drop(first);
        while stream.next_event()["data"]["attempt"] != 2 {}
        while stream.next_event()["event"] != "step" {}
        // After the lease the first worker, which is running again, has the job; writes of the second worker are
        // refused.
        signal(&second, "-STOP");
        let third = start("worker", first_data.path(), &database, &bucket);
        while stream.next_event()["data"]["attempt"] != 3 {}
        signal(&second, "-CONT");
        let ended = finished(&api, &job);
        assert_eq!((&ended["status"], &ended["attempt"]), (&json!("succeeded"), &json!(3)), "{ended}");
        let resumed = String::from_utf8(third.get("/metrics").body).unwrap();
        assert!(resumed.contains("prosopon_jobs_resumed_total 1"), "{resumed}");
        let is_built = |kind: &str| {
            let of_kind = format!("kind=\"{kind}\",outcome=\"miss\"");
            resumed.lines().any(|line| line.starts_with("prosopon_cache_requests_total") && line.contains(&of_kind))
        };
        assert!(!is_built("field") && !is_built("mesh"), "it read what the first worker had stored: {resumed}");
        assert_eq!(rows.count(at_hand), 0);
        let steps: Vec<Value> = api.get_lines(&events).into_iter().filter(|e| e["event"] == "step").collect();
        assert_eq!(steps.len(), 16, "each step is reported once");
        let shared = frames(&api, &job);
        drop((api, second, third));

        let server = Server::start(alone.path(), &[]);
        let job = solve_demo_plan(&server);
        assert_eq!(finished(&server, &job)["status"], "succeeded");
        assert!(frames(&server, &job) == shared, "bit for bit those of one process");
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn all_steps_of_a_job_are_compared_with_one_target() {
    let bucket = Bucket::start().await;
    let database = fresh_database().await;
    tokio::task::block_in_place(move || {
        let [api_data, first_data, second_data] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let api = start("serve --no-worker", api_data.path(), &database, &bucket);
        let first = start("worker", first_data.path(), &database, &bucket);
        let steps = "SELECT count(*) FROM steps";
        let (session, request) = planned(&api);
        let target = |spacing_mm| {
            let head = phantom::head();
            let surface = phantom::surface_of(head.skin.as_ref(), &head.bounds(), spacing_mm).unwrap();
            api.upload(&format!("{session}/target"), &export::stl(&surface)).ok();
        };
        target(4.0);
        let accept = || api.post(&format!("{session}/jobs"), &request).ok();
        let job = accept();
        let mut rows = Rows::open(&database);
        let at_hand = "SELECT count(milestone_blob) FROM jobs";
        while rows.count(at_hand) == 0 {}
        drop(first);
        let before = rows.count(steps);
        target(5.0);
        let second = start("worker", second_data.path(), &database, &bucket);
        // This worker starts at rest and is killed before it writes a checkpoint.
        while rows.count(at_hand) == 1 {}
        assert!(rows.count(steps) < before, "nothing of both is there at the same time");
        while rows.count(steps) == 0 {}
        drop(second);
        target(4.0);
        let third = start("worker", first_data.path(), &database, &bucket);
        assert_eq!(finished(&api, &job)["status"], "succeeded");
        let metrics = String::from_utf8(third.get("/metrics").body).unwrap();
        assert!(!metrics.contains("prosopon_jobs_resumed_total 1"), "{metrics}");
        api.get(&format!("/v1/jobs/{}/steps/1/error", job["id"].as_str().unwrap())).ok();
        let again = accept();
        assert_ne!(again["id"], job["id"]);
        assert_eq!(finished(&api, &again)["status"], "succeeded");
        assert!(frames(&api, &again) == frames(&api, &job), "values of errors are part of frames");
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_is_cancelled_through_another_process() {
    let bucket = Bucket::start().await;
    let database = fresh_database().await;
    tokio::task::block_in_place(move || {
        let [api_data, worker_data] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let api = start("serve --no-worker", api_data.path(), &database, &bucket);
        let worker = start("worker", worker_data.path(), &database, &bucket);
        let job = solve_demo_plan(&api);
        let mut stream = api.stream(&format!("/v1/jobs/{}/events", job["id"].as_str().unwrap()));
        while stream.next_event()["event"] != "step" {}
        api.post(&format!("/v1/jobs/{}/cancel", job["id"].as_str().unwrap()), &json!({})).ok();
        while stream.next_event()["event"] != "end" {}
        assert_eq!(finished(&api, &job)["status"], "cancelled");
        // The worker takes the next job.
        let session = api.session_with_field();
        assert!(api.get(&session).ok()["parts"]["field"].is_object());
        assert_eq!((worker.get("/readyz").status, worker.get("/livez").status), (200, 200));
        worker.get(&session).refused(404, "not-found", "nothing at this path");
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[allow(clippy::disallowed_methods, reason = "what does not happen takes time")]
async fn only_api_processes_delete_what_expires() {
    let (bucket, database) = (Bucket::start().await, fresh_database().await);
    tokio::task::block_in_place(move || {
        let [api_data, worker_data] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let kept = "SELECT house_kept FROM store";
        let _worker = start("worker", worker_data.path(), &database, &bucket);
        let mut rows = Rows::open(&database);
        std::thread::sleep(Duration::from_secs(1));
        assert_eq!(rows.count(kept), 0);
        let _api = start("serve --no-worker", api_data.path(), &database, &bucket);
        while rows.count(kept) == 0 {}
    });
}
