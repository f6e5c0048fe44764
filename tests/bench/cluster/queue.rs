//! The queue alone: jobs are stored, claimed and finished by several clients at the same time.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use prosopon_store::{
    Claim, Insertion, JobChange, JobKind, JobRecord, JobState, Lane, NewJob, QueueLimits, SessionId, SessionRecord,
    Store, StoreLocation, WorkerId, now_rfc3339,
};

use crate::Row;
use crate::processes::Site;

/// Number of jobs in the queue, and number of rounds.
const JOBS: usize = 256;
const ROUNDS: usize = 6;
const SESSIONS: usize = 16;
const TENANTS: usize = 4;

/// Operations per second and their 99th percentile, on both engines, with 1 to 8 clients.
pub(crate) fn operations(site: &Site) -> Vec<Row> {
    site.runtime.block_on(async {
        let mut rows = Vec::new();
        for engine in ["embedded", "shared"] {
            for clients in [1, 2, 4, 8] {
                let directory = tempfile::tempdir().unwrap();
                let database = (engine == "shared").then_some(site.cluster.fresh_database().await);
                let places = StoreLocation {
                    database: database.map(|d| d.parse().unwrap()),
                    blobs: None,
                    ..StoreLocation::default()
                };
                let store = Store::open_at(directory.path(), &places).await.unwrap();
                let mut all = measure(&store, clients).await;
                for _ in 1..ROUNDS {
                    for ((_, times), (_, more)) in all.iter_mut().zip(measure(&store, clients).await) {
                        times.each.extend(more.each);
                        times.all += more.all;
                    }
                }
                for (operation, times) in all {
                    let row = |what: String, value, unit| Row { what, engine, clients, value, unit };
                    rows.push(row(operation.to_owned(), times.per_second(), "1/s"));
                    rows.push(row(format!("{operation}: 99 of 100 below"), times.p99_ms(), "ms"));
                }
                store.close().await;
            }
        }
        rows
    })
}

struct Times {
    each: Vec<Duration>,
    all: Duration,
}

impl Times {
    fn per_second(&self) -> f64 {
        self.each.len() as f64 / self.all.as_secs_f64()
    }

    fn p99_ms(&self) -> f64 {
        let mut each = self.each.clone();
        each.sort();
        each[each.len() * 99 / 100].as_secs_f64() * 1e3
    }
}

async fn measure(store: &Store, clients: usize) -> [(&'static str, Times); 3] {
    let mut sessions = Vec::new();
    for n in 0..SESSIONS {
        let tenant = format!("tenant{}", n % TENANTS).parse().unwrap();
        let record = SessionRecord {
            id: SessionId::new(),
            tenant,
            label: None,
            settings: "{}".to_owned(),
            created_at: now_rfc3339(),
        };
        store.insert_session(&record, None).await.unwrap();
        sessions.push(record.id);
    }
    let (stored, _) = by_all(clients, {
        let (store, sessions) = (store.clone(), Arc::new(sessions));
        move |n| {
            let (store, job) =
                (store.clone(), JobRecord::accepted(JobKind::Solve, sessions[n % SESSIONS], n.to_string()));
            async move {
                let limits = QueueLimits { all: u32::MAX, tenant: u32::MAX };
                let new = NewJob { job: &job, limits, event: "{}", supersede: None, answer: &|_, _| None };
                assert!(matches!(store.insert_job(&new).await.unwrap(), Insertion::Stored { .. }));
            }
        }
    })
    .await;
    let name = WorkerId::new();
    let (claimed, jobs) = by_all(clients, {
        let store = store.clone();
        move |_| {
            let store = store.clone();
            async move {
                let change =
                    |_: &JobRecord| JobChange { attempt_change: 1, events: reported("status"), ..JobChange::default() };
                // All claims use one name; otherwise jobs would be reserved for the worker that knows their session.
                let worker = store.is_shared().then_some(name);
                let (patience, lease) = (Claim::PATIENCE, Duration::from_secs(60));
                let claim = Claim { lane: Lane::Heavy, worker, patience, to: JobState::Running, lease };
                store.claim_job(&claim, &change).await.unwrap().expect("there is one job per claim")
            }
        }
    })
    .await;
    assert_eq!(jobs.iter().map(|job| job.id).collect::<BTreeSet<_>>().len(), JOBS, "each job is claimed once");
    let (ended, _) = by_all(clients, {
        let (store, jobs) = (store.clone(), Arc::new(jobs));
        move |n| {
            let (store, jobs) = (store.clone(), Arc::clone(&jobs));
            async move {
                let change = JobChange { events: reported("end"), ..JobChange::default() };
                assert!(store.change_job(&jobs[n], JobState::Succeeded, &change).await.unwrap());
            }
        }
    })
    .await;
    [("jobs stored", stored), ("jobs claimed", claimed), ("jobs ended", ended)]
}

fn reported(kind: &'static str) -> Vec<(&'static str, String)> {
    vec![(kind, "{}".to_owned())]
}

/// Runs `work` for 0 to [`JOBS`] in `clients` tasks; returns times and results.
async fn by_all<T, F, W>(clients: usize, work: F) -> (Times, Vec<T>)
where
    T: Send + 'static,
    F: Fn(usize) -> W + Clone + Send + 'static,
    W: Future<Output = T> + Send,
{
    let next = Arc::new(AtomicUsize::new(0));
    let started = Instant::now();
    let tasks: Vec<_> = (0..clients)
        .map(|_| {
            let (next, work) = (Arc::clone(&next), work.clone());
            tokio::spawn(async move {
                let mut done = Vec::new();
                loop {
                    let n = next.fetch_add(1, Ordering::Relaxed);
                    if n >= JOBS {
                        return done;
                    }
                    let started = Instant::now();
                    done.push((work(n).await, started.elapsed()));
                }
            })
        })
        .collect();
    let (mut results, mut each) = (Vec::new(), Vec::new());
    for task in tasks {
        for (result, time) in task.await.unwrap() {
            results.push(result);
            each.push(time);
        }
    }
    (Times { each, all: started.elapsed() }, results)
}
