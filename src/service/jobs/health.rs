use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::Service;
use super::running::Worker;

/// A worker without a heartbeat for this long is stuck.
const SILENCE: Duration = Duration::from_secs(60);
/// Work that ignores a stop for this long is stuck: solvers check for a stop in every Newton iteration.
const DEAF: Duration = Duration::from_secs(180);

/// Last heartbeat of each worker.
#[derive(Debug)]
pub(super) struct Beats {
    begin: Instant,
    /// Time of the last heartbeat, ms since `begin`.
    last: Vec<(Worker, AtomicU64)>,
}

impl Beats {
    pub(super) fn new(workers: Vec<Worker>) -> Self {
        Self { begin: Instant::now(), last: workers.into_iter().map(|w| (w, AtomicU64::new(0))).collect() }
    }

    pub(super) fn beat(&self, worker: Worker) {
        let now = u64::try_from(self.begin.elapsed().as_millis()).unwrap_or(u64::MAX);
        if let Some((_, last)) = self.last.iter().find(|(w, _)| *w == worker) {
            last.store(now, Ordering::Relaxed);
        }
    }

    /// Time since the last heartbeat of each worker.
    fn silences(&self) -> impl Iterator<Item = (Worker, Duration)> {
        let since = |last: &AtomicU64| Duration::from_millis(last.load(Ordering::Relaxed));
        self.last.iter().map(move |(w, last)| (*w, self.begin.elapsed().saturating_sub(since(last))))
    }
}

impl Service {
    /// Descriptions of stuck workers and jobs; empty while all is well, also while a solver is busy.
    #[must_use]
    pub fn wedged(&self) -> Vec<String> {
        self.wedged_for(SILENCE, DEAF)
    }

    fn wedged_for(&self, silence: Duration, deaf: Duration) -> Vec<String> {
        let mut faults = Vec::new();
        for (worker, silent) in self.beats.silences() {
            if silent > silence && !self.stop.is_cancelled() {
                let (lane, number) = (worker.lane.as_str(), worker.number);
                faults.push(format!(
                    "worker {number} of the {lane} lane has had no heartbeat for {} s",
                    silent.as_secs()
                ));
            }
        }
        for running in self.running_jobs() {
            let ignoring = running.ignoring_stop();
            if ignoring > deaf {
                faults.push(format!("job {} should have stopped {} s ago", running.job, ignoring.as_secs()));
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::running::Running;
    use prosopon_store::{JobKind, JobRecord, Lane, SessionId};

    #[test]
    fn work_that_is_over_ignores_no_stop() {
        let job = JobRecord::accepted(JobKind::Field, SessionId::new(), String::new());
        let running =
            Running::new(&job, Worker { lane: Lane::Heavy, number: 0 }, Duration::from_secs(60), f64::INFINITY);
        assert!(running.ignoring_stop().is_zero());
        running.control.cancel();
        while running.ignoring_stop().is_zero() {}
        running.close();
        assert!(running.ignoring_stop().is_zero(), "its end may wait for a store");
    }

    #[test]
    fn a_worker_that_does_not_beat_is_silent() {
        let workers = Worker::all(2);
        let beats = Beats { begin: Instant::now() - Duration::from_secs(100), ..Beats::new(workers.clone()) };
        assert!(workers.len() == 3 && beats.silences().all(|(_, silent)| silent > SILENCE));
        beats.beat(workers[1]);
        let silent: Vec<Worker> = beats.silences().filter(|(_, s)| *s > SILENCE).map(|(w, _)| w).collect();
        assert_eq!(silent, [workers[0], workers[2]], "others do not hide it");
    }
}
