use std::time::Duration;

use super::Service;
use prosopon_store::JobId;

/// A worker without a heartbeat for this long is stuck.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(60);
/// Stopped work mostly ends within a second; while it holds its threads for longer, other jobs wait.
const STOP_GRACE: Duration = Duration::from_secs(1);
/// Time between two looks for stuck work.
const LOOK_FOR_STUCK: Duration = Duration::from_secs(1);

/// A computation that has ignored its stop for too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the computation of job {job} has ignored its stop for {} s and holds the processors; the process ends and must be started again", ignored.as_secs())]
pub struct StuckComputation {
    /// The job, which has ended.
    pub job: JobId,
    /// How long the computation has ignored the stop.
    pub ignored: Duration,
}

impl Service {
    /// Descriptions of stuck workers and jobs; empty while all is well, also while a solver is busy.
    #[must_use]
    pub fn stuck(&self) -> Vec<String> {
        self.stuck_for(HEARTBEAT_TIMEOUT, self.settings.stuck_after)
    }

    /// Number of jobs whose computation has not seen its stop yet.
    #[must_use]
    pub fn ignoring_stop(&self) -> usize {
        self.running_jobs().iter().filter(|running| !running.ignoring_stop().is_zero()).count()
    }

    /// Whether stopped work holds threads for which other jobs wait.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.running_jobs().iter().any(|running| running.ignoring_stop() > STOP_GRACE)
    }

    /// Waits until a computation has ignored its stop for [`ServiceSettings::stuck_after`](crate::ServiceSettings). Nothing
    /// within the process can end it.
    pub async fn until_stuck(&self) -> StuckComputation {
        loop {
            for running in self.running_jobs() {
                let ignored = running.ignoring_stop();
                if ignored > self.settings.stuck_after {
                    return StuckComputation { job: running.job, ignored };
                }
            }
            tokio::time::sleep(LOOK_FOR_STUCK).await;
        }
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
