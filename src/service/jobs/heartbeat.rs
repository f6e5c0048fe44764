use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::running::Worker;

/// Last heartbeat of each worker.
#[derive(Debug)]
pub(super) struct Heartbeats {
    begin: Instant,
    /// Time of the last heartbeat, ms since `begin`.
    last: Vec<(Worker, AtomicU64)>,
}

impl Heartbeats {
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
    pub(super) fn silences(&self) -> impl Iterator<Item = (Worker, Duration)> {
        let since = |last: &AtomicU64| Duration::from_millis(last.load(Ordering::Relaxed));
        self.last.iter().map(move |(w, last)| (*w, self.begin.elapsed().saturating_sub(since(last))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(60);

    #[test]
    fn a_worker_that_does_not_beat_is_silent() {
        let workers = Worker::all(2);
        let beats = Heartbeats { begin: Instant::now() - Duration::from_secs(100), ..Heartbeats::new(workers.clone()) };
        assert!(workers.len() == 3 && beats.silences().all(|(_, silent)| silent > HEARTBEAT_TIMEOUT));
        beats.beat(workers[1]);
        let silent: Vec<Worker> = beats.silences().filter(|(_, s)| *s > HEARTBEAT_TIMEOUT).map(|(w, _)| w).collect();
        assert_eq!(silent, [workers[0], workers[2]], "others do not hide it");
    }
}
