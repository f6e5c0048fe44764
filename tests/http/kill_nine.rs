//! A stream of jobs on the real binary, which is killed repeatedly at random moments.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use ureq::Agent;

use crate::support::binary::{Server, serve};
use crate::support::tissue_mesh::slab;

/// Number of kills: 50 with `SLOW_TESTS`, else 6.
fn kills() -> usize {
    if std::env::var_os("SLOW_TESTS").is_some() { 50 } else { 6 }
}

/// Pseudo-random numbers, the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }
}

/// Posts a job with an idempotency key; `None` when the answer did not arrive.
fn ask(agent: &Agent, server: &Server, session: &str, key: usize, body: &Value) -> Option<Value> {
    let request = agent.post(format!("{}{session}/jobs", server.url)).header("idempotency-key", format!("job-{key}"));
    let mut answer = request.send_json(body).ok()?;
    assert_eq!(answer.status().as_u16(), 202);
    answer.body_mut().read_json().ok()
}

#[test]
fn no_job_is_lost_or_corrupt_after_repeated_kills() {
    let directory = tempfile::tempdir().unwrap();
    let data = directory.path();
    let start = || {
        let mut command = serve(data, "127.0.0.1:0");
        command.env("PROSOPON_MAX_ATTEMPTS", "1000").env("PROSOPON_MAX_WAITING", "1000");
        Server::spawn(command)
    };
    let agent: Agent = Agent::config_builder().timeout_global(Some(Duration::from_secs(30))).build().into();
    let mut server = start();
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();

    let (mut random, mut accepted, mut killed) = (Random(7), BTreeMap::new(), 0);
    let mut key = 0;
    let mut next_kill = Instant::now() + Duration::from_millis(200);
    while killed < kills() {
        // Without contact, different tolerances make different jobs with the same result. Their number keeps the test
        // short.
        if accepted.len() < kills() / 2 + 3 {
            let tolerance = 0.05 + 1e-4 * key as f64;
            let body = json!({"plan": plan, "model": "linear", "steps": 3, "penetration_tolerance_mm": tolerance});
            if let Some(job) = ask(&agent, &server, &session, key, &body) {
                accepted.insert(key, job["id"].as_str().unwrap().to_owned());
                key += 1;
            }
        }
        if Instant::now() >= next_kill {
            server.child.kill().unwrap();
            server.child.wait().unwrap();
            killed += 1;
            server = start();
            next_kill = Instant::now() + Duration::from_millis(random.below(400));
        }
        std::thread::park_timeout(Duration::from_millis(random.below(30)));
    }

    // Nothing is lost: every job whose 202 arrived exists and ends.
    let mut frames: BTreeMap<u64, Vec<u8>> = BTreeMap::new();
    let mut attempts = 0;
    for (key, id) in &accepted {
        let own = format!("/v1/jobs/{id}");
        let ended = server.finish(&server.get(&own));
        attempts += ended["attempt"].as_u64().unwrap();
        assert_eq!(ended["step"], 3, "job {key}: {ended}");
        // Nothing is corrupt: all jobs solve the same scene, so all frames are identical.
        for k in 1..=3 {
            let frame = server.get(&format!("{own}/steps/{k}/frame")).body;
            assert!(
                !frame.is_empty() && frames.entry(k).or_insert_with(|| frame.clone()) == &frame,
                "job {key} step {k}"
            );
        }
        server.get(&format!("{own}/report")).ok();
        let events = server.get_lines(&format!("{own}/events"));
        let ids: Vec<u64> = events.iter().map(|e| e["id"].as_u64().unwrap()).collect();
        assert!(ids.windows(2).all(|w| w[0] < w[1]), "{ids:?}");
        let count = |name: &str| events.iter().filter(|e| e["event"] == name).count();
        assert_eq!((count("end"), events.last().unwrap()["event"].as_str()), (1, Some("end")), "job {key}");
        assert_eq!(count("step"), 3, "a step that an earlier attempt finished is reported once: job {key}");
    }
    // A request whose answer was lost was sent again with its key: no job exists twice.
    let listed = server.get("/v1/jobs?limit=100").ok();
    assert_eq!(listed["jobs"].as_array().unwrap().len(), accepted.len());
    eprintln!("{killed} kills, {} jobs accepted, {attempts} attempts, 0 lost, 0 corrupt", accepted.len());

    // The next start removes unreferenced files: what remains is the mesh, and for each job the skin at rest and three
    // frames.
    drop(server);
    let server = start();
    let blobs = data.join("blobs").join(session.rsplit('/').next().unwrap());
    assert_eq!(std::fs::read_dir(blobs).unwrap().count(), 1 + 4 * accepted.len());
    drop(server);
}
