use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::json;

use super::client::Client;
use super::latencies::{Kind, Latencies};
use super::scene::{Scene, skin};
use crate::error::BenchError;

/// Composition and duration of the load.
#[derive(Debug, Clone, Copy)]
pub(super) struct Load {
    pub(super) sessions: usize,
    pub(super) pollers: usize,
    pub(super) followers: usize,
    pub(super) uploaders: usize,
    pub(super) solvers: usize,
    pub(super) seconds: f64,
    /// Pause of a poller between two reads.
    pub(super) pause: Duration,
    /// Pause of an uploader between two uploads.
    pub(super) upload_pause: Duration,
}

/// Result of the load.
#[derive(Debug)]
pub(super) struct Loaded {
    pub(super) latencies: Latencies,
    pub(super) solved: usize,
    pub(super) events: usize,
    pub(super) seconds: f64,
}

/// State shared by all threads.
#[derive(Debug)]
struct Shared {
    url: String,
    stop: AtomicBool,
    /// Paths of the jobs that run or wait, by solver.
    jobs: Mutex<Vec<Option<String>>>,
    solved: AtomicUsize,
    events: AtomicUsize,
}

impl Shared {
    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Waits for `duration` or until the load ends.
    fn pause(&self, duration: Duration) {
        let end = Instant::now() + duration;
        while !self.stopped() && Instant::now() < end {
            thread::park_timeout((end - Instant::now()).min(Duration::from_millis(50)));
        }
    }

    fn job(&self, number: usize) -> Option<String> {
        let jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.get(number % jobs.len().max(1)).cloned().flatten()
    }

    fn set_job(&self, solver: usize, job: Option<String>) {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)[solver] = job;
    }
}

impl Load {
    pub(super) fn run(&self, url: &str) -> Result<Loaded, BenchError> {
        let mut client = Client::new(url);
        let skin = skin()?;
        let mut sessions = Vec::new();
        for _ in 0..self.sessions {
            sessions.push(client.session()?);
        }
        let mut scenes = Vec::new();
        for _ in 0..self.solvers {
            scenes.push(Scene::LARGE.prepare(&mut client)?);
        }
        let shared = Shared {
            url: url.to_owned(),
            stop: AtomicBool::new(false),
            jobs: Mutex::new(vec![None; self.solvers]),
            solved: AtomicUsize::new(0),
            events: AtomicUsize::new(0),
        };
        let (shared, sessions) = (&shared, &sessions);
        let begun = Instant::now();
        let latencies = thread::scope(|scope| {
            let mut threads = Vec::new();
            for (n, (session, plan)) in scenes.iter().enumerate() {
                threads.push(scope.spawn(move || solver(shared, n, session, plan)));
            }
            for n in 0..self.pollers {
                threads.push(scope.spawn(move || poller(shared, n, sessions, self.pause)));
            }
            for n in 0..self.followers {
                threads.push(scope.spawn(move || follower(shared, n)));
            }
            for n in 0..self.uploaders {
                let skin = &skin;
                threads.push(scope.spawn(move || uploader(shared, n, sessions, skin, self.upload_pause)));
            }
            shared.pause(Duration::from_secs_f64(self.seconds));
            shared.stop.store(true, Ordering::Relaxed);
            // Cancelling the jobs ends the event streams and the waits of the solvers.
            for solver in 0..self.solvers {
                if let Some(job) = shared.job(solver) {
                    client.post(Kind::Other, &format!("{job}/cancel"), &json!({})).ok();
                }
            }
            let mut all = Latencies::default();
            for thread in threads {
                all.join(thread.join().unwrap_or_default());
            }
            all
        });
        let (solved, events) = (shared.solved.load(Ordering::Relaxed), shared.events.load(Ordering::Relaxed));
        Ok(Loaded { latencies, solved, events, seconds: begun.elapsed().as_secs_f64() })
    }
}

/// Keeps one job in the queue.
fn solver(shared: &Shared, solver: usize, session: &str, plan: &str) -> Latencies {
    let mut client = Client::new(&shared.url);
    for number in 0.. {
        if shared.stopped() {
            break;
        }
        let Ok(job) = client.solve(session, &Scene::LARGE.solve(plan, number)) else { break };
        shared.set_job(solver, Some(job.clone()));
        match client.finish(&job).as_deref() {
            Ok("succeeded") => _ = shared.solved.fetch_add(1, Ordering::Relaxed),
            Ok("cancelled") if shared.stopped() => {}
            Ok(status) => _ = client.latencies.error(Kind::Other, &format!("a solve ended as {status}")),
            Err(_) => break,
        }
    }
    client.latencies
}

/// Reads the status of a job most of the time, and sometimes a session or the list, as an open page does.
fn poller(shared: &Shared, poller: usize, sessions: &[String], pause: Duration) -> Latencies {
    let mut client = Client::new(&shared.url);
    // Stagger the pollers.
    shared.pause(pause.mul_f64(poller as f64 / 50.0));
    for round in 0.. {
        if shared.stopped() {
            break;
        }
        // The client counts errors.
        _ = match (round % 10, shared.job(poller)) {
            (9, _) if poller.is_multiple_of(5) => list(&mut client),
            (1 | 5, _) | (_, None) => {
                client.get(Kind::Session, &sessions[(poller * 31 + round) % sessions.len()]).map(drop)
            }
            (_, Some(job)) => client.get(Kind::Job, &job).map(drop),
        };
        shared.pause(pause);
    }
    client.latencies
}

/// Reads the list of all sessions, page by page.
fn list(client: &mut Client) -> Result<(), BenchError> {
    let mut next = Some("/v1/sessions?limit=100".to_owned());
    while let Some(path) = next {
        next = client.get(Kind::List, &path)?["next"].as_str().map(str::to_owned);
    }
    Ok(())
}

fn follower(shared: &Shared, follower: usize) -> Latencies {
    let mut client = Client::new(&shared.url);
    let mut last = None;
    while !shared.stopped() {
        match shared.job(follower) {
            Some(job) if last.as_ref() != Some(&job) => {
                if let Ok(events) = client.follow(&job) {
                    shared.events.fetch_add(events, Ordering::Relaxed);
                }
                last = Some(job);
            }
            _ => shared.pause(Duration::from_millis(20)),
        }
    }
    client.latencies
}

fn uploader(shared: &Shared, uploader: usize, sessions: &[String], skin: &[u8], pause: Duration) -> Latencies {
    let mut client = Client::new(&shared.url);
    for round in 0.. {
        if shared.stopped() {
            break;
        }
        let session = &sessions[(uploader * 97 + round * 7) % sessions.len()];
        client.upload(Kind::Upload, &format!("{session}/skin"), skin).ok();
        shared.pause(pause);
    }
    client.latencies
}
