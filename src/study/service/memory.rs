use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use super::client::Client;
use super::latencies::{Kind, Latencies};
use super::scene::Scene;
use super::server::Server;
use crate::error::BenchError;

/// Sessions that the jobs are spread over.
const SESSIONS: usize = 10;
/// Clients at the same time; each waits for its job.
const CLIENTS: usize = 4;
/// Interval between two samples of the memory.
const SAMPLE_EVERY: Duration = Duration::from_millis(250);

/// A sample of the server's memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub(super) jobs: usize,
    pub(super) wall_s: f64,
    pub(super) memory_mb: f64,
}

/// Solves `jobs` small scenes and samples the memory of the server meanwhile.
pub(super) fn run(server: &Server, jobs: usize) -> Result<(Vec<Sample>, Latencies), BenchError> {
    let mut client = Client::new(&server.url);
    let mut scenes = Vec::new();
    for _ in 0..SESSIONS {
        scenes.push(Scene::SMALL.prepare(&mut client)?);
    }
    let (next, done, scenes) = (&AtomicUsize::new(0), &AtomicUsize::new(0), &scenes);
    let begun = Instant::now();
    Ok(thread::scope(|scope| {
        let work = move || {
            let mut client = Client::new(&server.url);
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= jobs {
                    return client.latencies;
                }
                let (session, plan) = &scenes[number % scenes.len()];
                let ended =
                    client.solve(session, &Scene::SMALL.solve(plan, number)).and_then(|job| client.finish(&job));
                if ended.is_ok_and(|status| status != "succeeded") {
                    client.latencies.error(Kind::Other, &"a small job did not succeed");
                }
                done.fetch_add(1, Ordering::Relaxed);
            }
        };
        let clients: Vec<_> = (0..CLIENTS).map(|_| scope.spawn(work)).collect();
        let mut samples = Vec::new();
        loop {
            let jobs_done = done.load(Ordering::Relaxed);
            let at = |memory_mb| Sample { jobs: jobs_done, wall_s: begun.elapsed().as_secs_f64(), memory_mb };
            samples.extend(server.memory_mb().map(at));
            if jobs_done >= jobs {
                break;
            }
            thread::park_timeout(SAMPLE_EVERY);
        }
        let mut latencies = Latencies::default();
        for client in clients {
            latencies.join(client.join().unwrap_or_default());
        }
        (samples, latencies)
    }))
}

/// Memory of the server over the second half of the jobs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plateau {
    /// Median over the third quarter, MB.
    pub(super) third_mb: f64,
    /// Median over the last quarter, MB.
    pub(super) last_mb: f64,
}

impl Plateau {
    /// `None` when a quarter has no sample.
    pub(super) fn of(samples: &[Sample]) -> Option<Self> {
        let most = samples.last()?.jobs;
        let median = |from: usize, to: usize| {
            let within = samples.iter().filter(|s| s.jobs * 4 >= most * from && s.jobs * 4 <= most * to);
            let mut mb: Vec<f64> = within.map(|s| s.memory_mb).collect();
            mb.sort_by(f64::total_cmp);
            mb.get(mb.len() / 2).copied()
        };
        Some(Self { third_mb: median(2, 3)?, last_mb: median(3, 4)? })
    }

    /// Relative growth from the third to the last quarter.
    pub(super) fn growth(&self) -> f64 {
        self.last_mb / self.third_mb - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plateau_does_not_grow_and_a_leak_does() {
        let samples = |memory: fn(f64) -> f64| -> Vec<Sample> {
            (0..=100).map(|jobs| Sample { jobs, wall_s: 0.0, memory_mb: memory(jobs as f64) }).collect()
        };
        let flat = Plateau::of(&samples(|n| 100.0 + n.min(30.0))).unwrap();
        assert_eq!((flat.third_mb, flat.growth()), (130.0, 0.0));
        // 1 MB a job: medians 25 jobs apart.
        let leak = Plateau::of(&samples(|n| 100.0 + n)).unwrap();
        assert!((leak.last_mb - leak.third_mb - 25.0).abs() <= 1.0, "{leak:?}");
        assert_eq!(Plateau::of(&[]), None);
    }
}
