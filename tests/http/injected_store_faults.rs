//! Faults of the database, the bucket and the processes while jobs run.

use std::collections::BTreeSet;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::engines::{Bucket, Cluster, Mood, fresh_database};
use crate::support::binary::Server;
use crate::support::processes::{Rows, finished, signal, solve_demo_plan, start};

/// Number of jobs: 200 with `SLOW_TESTS`, which takes six minutes.
static JOBS: LazyLock<usize> = LazyLock::new(|| if std::env::var_os("SLOW_TESTS").is_some() { 200 } else { 40 });
const SESSIONS: usize = 4;
const STEPS: u64 = 2;
/// One job in this many is repeated in a single process; 9 covers all sessions and limits the time.
const CHECKED: usize = 9;

/// Different plans on the coarse phantom, one per job; every call gives the same plans with other ids.
fn plans(server: &Server) -> Vec<(String, Value)> {
    let of_session = |_| {
        let session = server.session_with_field();
        let (osteotomy, jaw) = server.cut(&session);
        let mesh = json!({ "osteotomy": osteotomy, "edge_mm": 9.0 });
        server.finish(&server.post(&format!("{session}/mesh"), &mesh));
        (session, osteotomy, jaw)
    };
    let sessions: Vec<_> = (0..SESSIONS).map(of_session).collect();
    let plan = |n: usize| {
        let (session, osteotomy, jaw) = &sessions[n % SESSIONS];
        let forward = -2.0 - 0.01 * n as f64;
        let waypoints = json!([{ "t": 1, "translation_mm": [0, forward, 0] }]);
        let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
        (session.clone(), server.post(&format!("{session}/plans"), &plan).ok()["id"].clone())
    };
    (0..*JOBS).map(plan).collect()
}

fn solve(server: &Server, (session, plan): &(String, Value)) -> Value {
    server.post(&format!("{session}/jobs"), &json!({ "plan": plan, "model": "linear", "steps": STEPS })).ok()
}

fn last_frame(server: &Server, job: &Value) -> Vec<u8> {
    server.get(&format!("/v1/jobs/{}/steps/{STEPS}/frame", job["id"].as_str().unwrap())).body
}

fn events_of(job: &Value) -> String {
    format!("/v1/jobs/{}/events", job["id"].as_str().unwrap())
}

/// Two API processes and three workers on one database and one bucket, under all faults of processes, database and
/// bucket.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[allow(clippy::disallowed_methods, reason = "faults last for a time")]
async fn jobs_under_every_fault_equal_those_of_one_process() {
    let bucket = Bucket::start().await;
    let mut cluster = Cluster::start();
    let database = cluster.fresh_database().await;
    tokio::task::block_in_place(move || {
        let mut directories: Vec<TempDir> = Vec::new();
        let mut begin = |role: &str| {
            directories.push(tempfile::tempdir().unwrap());
            start(role, directories[directories.len() - 1].path(), &database, &bucket)
        };
        let (dying, api) = (begin("serve --no-worker"), begin("serve --no-worker"));
        let mut workers = [begin("worker"), begin("worker"), begin("worker")];
        let plans = plans(&api);
        // Suspended until the whole queue is stored.
        workers.iter().for_each(|worker| signal(worker, "-STOP"));
        let jobs: Vec<Value> = plans.iter().enumerate().map(|(n, p)| solve([&dying, &api][n % 2], p)).collect();
        assert_eq!(jobs.iter().map(|job| job["id"].as_str()).collect::<BTreeSet<_>>().len(), *JOBS);
        workers.iter().for_each(|worker| signal(worker, "-CONT"));

        // The job at `n` twentieths of the queue.
        let twentieth = |n: usize| &jobs[*JOBS * n / 20];
        finished(&api, twentieth(3));
        workers[0] = begin("worker");
        finished(&api, twentieth(6));
        signal(&workers[1], "-STOP");
        finished(&api, twentieth(8));
        // The lease is two seconds, so another worker has the job by now.
        std::thread::sleep(Duration::from_secs(3));
        signal(&workers[1], "-CONT");
        finished(&api, twentieth(9));
        cluster.restart();
        finished(&api, twentieth(12));
        bucket.set(Mood::Away);
        std::thread::sleep(Duration::from_secs(10));
        bucket.set(Mood::Serving);
        let last = &jobs[*JOBS - 1];
        let mut stream = dying.stream(&events_of(last));
        let mut seen = vec![stream.next_event()];
        while seen.last().is_some_and(|e| e["data"]["status"] != "running") {
            seen.push(stream.next_event());
        }
        drop(dying);
        let known = seen[seen.len() - 1]["id"].as_u64().unwrap();
        let mut stream = api.stream_after(&events_of(last), known);
        while seen.last().is_some_and(|e| e["event"] != "end") {
            seen.push(stream.next_event());
        }
        seen.retain(|e| e["event"] != "heartbeat");
        assert!(seen.is_sorted_by(|a, b| a["id"].as_u64() < b["id"].as_u64()), "{seen:?}");

        // From a client's view, nothing is lost and nothing is done twice.
        for job in &jobs {
            let ended = finished(&api, job);
            assert_eq!(ended["status"], "succeeded", "{ended}");
            let events = api.get_lines(&events_of(job));
            let of = |kind: &str| events.iter().filter(|e| e["event"] == kind).count() as u64;
            assert_eq!((of("step"), of("end")), (STEPS, 1), "{events:?}");
            assert!(events.is_sorted_by(|a, b| a["id"].as_u64() < b["id"].as_u64()), "{events:?}");
        }
        let restarted = jobs.iter().filter(|job| finished(&api, job)["attempt"].as_u64() > Some(1)).count();
        assert!(restarted >= 1, "a killed worker or a halted one had a job");
        let frames: Vec<Vec<u8>> = jobs.iter().map(|job| last_frame(&api, job)).collect();
        drop((api, workers));

        let alone = tempfile::tempdir().unwrap();
        let server = Server::start(alone.path(), &[]);
        let plans = self::plans(&server);
        for n in (0..*JOBS).step_by(CHECKED) {
            let job = solve(&server, &plans[n]);
            assert_eq!(finished(&server, &job)["status"], "succeeded");
            assert!(last_frame(&server, &job) == frames[n], "job {n}: bit for bit that of one process");
        }
        assert_eq!(frames.iter().collect::<BTreeSet<_>>().len(), *JOBS, "plans differ");
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_unreadable_value_fails_only_jobs_that_need_it() {
    let bucket = Bucket::start().await;
    let database = fresh_database().await;
    tokio::task::block_in_place(move || {
        let [api_data, worker_data] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let api = start("serve --no-worker", api_data.path(), &database, &bucket);
        let worker = start("worker", worker_data.path(), &database, &bucket);
        let session = api.session_with_field();
        bucket.keep_back(Some(Rows::open(&database).text("SELECT blob FROM parts WHERE kind = 'skull'")));
        let settings = json!({ "spacing_mm": 2.5, "envelope_spacing_mm": 2.5, "envelope_closing_mm": 5.0 });
        api.put_json(&format!("{session}/field/settings"), &settings).ok();
        let field = || api.post(&format!("{session}/field"), &json!({})).ok();
        let ended = finished(&api, &field());
        assert_eq!((&ended["status"], &ended["attempt"]), (&json!("failed"), &json!(3)), "{ended}");
        assert_eq!(ended["problem"]["type"], "/problems/store-refuses", "{ended}");
        // Requests of other sessions are served.
        assert_eq!((worker.get("/readyz").status, worker.get("/livez").status), (200, 200));
        api.session_with_field();
        bucket.keep_back(None);
        assert_eq!(finished(&api, &field())["status"], "succeeded");
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[allow(clippy::disallowed_methods, reason = "faults last for a time")]
async fn store_faults_do_not_count_as_attempts_of_a_job() {
    let bucket = Bucket::start().await;
    let mut cluster = Cluster::start();
    let database = cluster.fresh_database().await;
    tokio::task::block_in_place(move || {
        let [api_data, first_data, second_data] = std::array::from_fn(|_| tempfile::tempdir().unwrap());
        let api = start("serve --no-worker", api_data.path(), &database, &bucket);
        let workers = [first_data.path(), second_data.path()].map(|data| start("worker", data, &database, &bucket));
        let job = solve_demo_plan(&api);
        let mut stream = api.stream(&format!("/v1/jobs/{}/events", job["id"].as_str().unwrap()));
        while stream.next_event()["event"] != "step" {}
        // Longer than a lease: no worker can renew a lease, and no worker can take a job.
        for (halted_ms, between_ms) in [(4000, 1000), (1200, 200), (4000, 300), (2000, 0), (4000, 1000)] {
            cluster.halt();
            std::thread::sleep(Duration::from_millis(halted_ms));
            cluster.go_on();
            std::thread::sleep(Duration::from_millis(between_ms));
        }
        bucket.set(Mood::Refusing);
        for server in [&api, &workers[0], &workers[1]] {
            // Just after the halts, the database may still be the reason that the server is not ready.
            while !String::from_utf8_lossy(&server.get("/readyz").body).contains("store-refuses") {}
            server.get("/readyz").refused(503, "store-refuses", "bucket");
            assert_eq!(server.get("/livez").status, 200);
        }
        // The job returns to the queue, and no worker takes it. If the bucket served again between the refusal of the job's
        // write and the worker's check of the bucket, the worker would blame the job.
        let mut other_status_at = Instant::now();
        while other_status_at.elapsed() < Duration::from_secs(4) {
            if api.get(&format!("/v1/jobs/{}", job["id"].as_str().unwrap())).json()["status"] != "accepted" {
                other_status_at = Instant::now();
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        bucket.set(Mood::Serving);
        let ended = finished(&api, &job);
        assert_eq!((&ended["status"], &ended["attempt"]), (&json!("succeeded"), &json!(1)), "{ended}");
        assert_eq!(api.get("/readyz").status, 200);
    });
}
