use std::time::Duration;

use super::Service;

/// A worker without a heartbeat for this long is stuck.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(60);
/// Work that ignores a stop for this long is stuck: solvers check for a stop in every Newton iteration.
const STOP_TIMEOUT: Duration = Duration::from_secs(180);

impl Service {
    /// Descriptions of stuck workers and jobs; empty while all is well, also while a solver is busy.
    #[must_use]
    pub fn stuck(&self) -> Vec<String> {
        self.stuck_for(HEARTBEAT_TIMEOUT, STOP_TIMEOUT)
    }

    fn stuck_for(&self, silence: Duration, deaf: Duration) -> Vec<String> {
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
    use crate::running::{Running, Worker};
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
}
