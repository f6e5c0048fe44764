//! When a job ends, by how its progress has grown in the present stage.

/// Progress of a stage over time; times in seconds on one clock, progress from 0 to 1 of the whole job.
#[derive(Debug, Clone, Copy)]
pub(super) struct Forecast {
    job_begin_s: f64,
    /// Time and progress at which the stage began.
    begin: (f64, f64),
    /// Time and progress at which the progress grew last.
    last: (f64, f64),
    /// By how much it grew then.
    gain: f64,
}

impl Forecast {
    /// Progress of the whole job from which on the job's own rate says something.
    const LEAST_PROGRESS: f64 = 0.03;

    pub(super) fn new(now_s: f64) -> Self {
        Self { job_begin_s: now_s, begin: (now_s, 0.0), last: (now_s, 0.0), gain: 0.0 }
    }

    /// A stage begins: what the stages before it took says nothing about it.
    pub(super) fn begin_stage(&mut self, now_s: f64, progress: f64) {
        *self = Self { begin: (now_s, progress), last: (now_s, progress), gain: 0.0, ..*self };
    }

    /// Notes the present progress; to be called every second or so.
    pub(super) fn see(&mut self, now_s: f64, progress: f64) {
        if progress > self.last.1 + 1e-6 {
            self.gain = progress - self.last.1;
            self.last = (now_s, progress);
        }
    }

    /// Time left, s; `None` before there is something to go by.
    ///
    /// The rest goes at the stage's mean rate. Between two reports the progress is taken to grow at that rate, but by no more than the last report
    /// did: a step that takes longer than those before it moves the end away.
    pub(super) fn left_s(&self, now_s: f64) -> Option<f64> {
        let done = self.last.1 - self.begin.1;
        if done <= 0.0 {
            let (done, elapsed) = (self.last.1, now_s - self.job_begin_s);
            return (done > Self::LEAST_PROGRESS).then(|| elapsed * (1.0 - done) / done);
        }
        let rate = done / (self.last.0 - self.begin.0).max(1e-3);
        let grown = (rate * (now_s - self.last.0)).min(self.gain);
        let present = (self.last.1 + grown).min(1.0);
        Some((now_s - self.begin.0) * (1.0 - present) / (present - self.begin.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds of the steps of solves of `bench operations` on a head CT (4 mm edges, two cores): a sagittal split, and both jaws.
    const STEPS_S: [&[f64]; 2] = [&[], &[]];

    #[test]
    fn from_a_fifth_on_the_end_is_known_to_a_factor_of_two() {
        for steps in STEPS_S {
            // Stages before the solve take 10 s and a tenth of the progress.
            let total: f64 = steps.iter().sum();
            let mut forecast = Forecast::new(0.0);
            forecast.see(9.0, 0.1);
            forecast.begin_stage(10.0, 0.1);
            for now in 0..total as usize {
                let now = now as f64;
                let mut begun = 0.0;
                let done = steps
                    .iter()
                    .take_while(|s| {
                        begun += **s;
                        begun <= now
                    })
                    .count();
                let progress = 0.1 + 0.9 * done as f64 / steps.len() as f64;
                forecast.see(10.0 + now, progress);
                if progress >= 0.2 {
                    let left = forecast.left_s(10.0 + now).unwrap();
                    let truth = total - now;
                    // The last seconds may be off by a few.
                    assert!(
                        left < 2.0 * truth + 2.0 && left > 0.5 * truth - 2.0,
                        "{now} s of {total}: {left} for {truth}"
                    );
                }
            }
        }
    }
}
