use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::Service;
use crate::store::Lane;

/// A scheduler that has not moved for so long is wedged.
const SILENCE: Duration = Duration::from_secs(60);
/// Work that goes on for so long after it should stop is wedged: solvers look at every Newton iteration.
const DEAF: Duration = Duration::from_secs(180);

/// When the scheduler of each lane last moved.
#[derive(Debug)]
pub(super) struct Beats {
    begin: Instant,
    /// Milliseconds since the beginning, by lane.
    last: [AtomicU64; Lane::ALL.len()],
}

impl Beats {
    pub(super) fn new() -> Self {
        Self { begin: Instant::now(), last: Default::default() }
    }

    pub(super) fn beat(&self, lane: Lane) {
        let now = u64::try_from(self.begin.elapsed().as_millis()).unwrap_or(u64::MAX);
        self.last[lane as usize].store(now, Ordering::Relaxed);
    }

    fn silence(&self, lane: Lane) -> Duration {
        let last = Duration::from_millis(self.last[lane as usize].load(Ordering::Relaxed));
        self.begin.elapsed().saturating_sub(last)
    }
}

impl Service {
    /// What is wedged, in words; nothing while all goes well, also while a solver is busy.
    #[must_use]
    pub fn wedged(&self) -> Vec<String> {
        self.wedged_for(SILENCE, DEAF)
    }

    fn wedged_for(&self, silence: Duration, deaf: Duration) -> Vec<String> {
        let mut faults = Vec::new();
        for lane in Lane::ALL {
            let silent = self.beats.silence(lane);
            if silent > silence && !self.stop.is_cancelled() {
                faults.push(format!(
                    "the scheduler of {} jobs has not moved for {} s",
                    lane.as_str(),
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

    #[test]
    fn a_lane_that_does_not_beat_is_silent() {
        let beats = Beats { begin: Instant::now() - Duration::from_secs(100), last: Default::default() };
        assert!(beats.silence(Lane::Heavy) > SILENCE);
        beats.beat(Lane::Heavy);
        assert!(beats.silence(Lane::Heavy) < SILENCE && beats.silence(Lane::Quick) > SILENCE);
    }
}
