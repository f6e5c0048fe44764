//! Cancellation, deadline and progress of long computations, on plain atomics.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Error of a computation that stopped because its caller asked for it or its deadline passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A clock: seconds since a fixed moment.
pub type Clock = fn() -> f64;

/// Cancel flag, deadline, memory limit and progress of one long computation.
///
/// Every long function takes one: it checks whether to stop and reports its progress. Clones share the cancel flag and the
/// progress value. [`Control::stage`] maps the progress of a stage to a share of the whole.
///
/// ```
/// use prosopon_geometry::control::{Cancelled, Control};
///
/// let control = Control::new();
/// let second_half = control.stage(0.5, 1.0);
/// second_half.report(0.5);
/// assert_eq!(control.progress(), 0.75);
///
/// control.cancel();
/// assert_eq!(second_half.check(), Err(Cancelled));
/// ```
#[derive(Debug, Clone)]
pub struct Control {
    cancel: Arc<AtomicBool>,
    progress: Arc<AtomicU64>,
    from: f64,
    to: f64,
    clock: Clock,
    /// Time on the clock at which the work counts as cancelled, s.
    deadline: Option<f64>,
    /// Memory that the work may allocate in addition to what is in use, MB.
    memory_mb: f64,
}

impl Default for Control {
    fn default() -> Self {
        Self::new()
    }
}

impl Control {
    /// A control with progress 0, not cancelled, without clock, deadline or memory limit.
    #[must_use]
    pub fn new() -> Self {
        Self {
            cancel: Arc::new(AtomicBool::new(false)),
            progress: Arc::new(AtomicU64::new(0f64.to_bits())),
            from: 0.0,
            to: 1.0,
            clock: || 0.0,
            deadline: None,
            memory_mb: f64::INFINITY,
        }
    }

    /// The same control with a clock, by which the work times its phases and which the deadline needs.
    #[must_use]
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { clock, ..self }
    }

    /// The same control with a deadline: it counts as cancelled once its clock shows `at` seconds.
    #[must_use]
    pub fn with_deadline(self, at: f64) -> Self {
        Self { deadline: Some(at), ..self }
    }

    /// A control that counts as cancelled `seconds` from now, or at the deadline if that is earlier.
    #[must_use]
    pub fn within(&self, seconds: f64) -> Self {
        let at = (self.clock)() + seconds;
        Self { deadline: Some(self.deadline.map_or(at, |deadline| deadline.min(at))), ..self.clone() }
    }

    /// Time to the deadline, s; infinite without one.
    #[must_use]
    pub fn left_s(&self) -> f64 {
        self.deadline.map_or(f64::INFINITY, |at| at - (self.clock)())
    }

    /// The same control with a memory limit, MB.
    ///
    /// A stage that would need more memory is refused before it begins.
    #[must_use]
    pub fn with_memory_mb(self, memory_mb: f64) -> Self {
        Self { memory_mb, ..self }
    }

    /// Memory that the work may allocate, MB; infinite unless [`Control::with_memory_mb`] set a limit.
    #[must_use]
    pub fn memory_mb(&self) -> f64 {
        self.memory_mb
    }

    /// Whether the deadline has passed.
    #[must_use]
    pub fn is_overdue(&self) -> bool {
        self.deadline.is_some_and(|at| (self.clock)() >= at)
    }

    /// The caller's clock; without one, a clock that always shows 0.
    ///
    /// Only the deadline and reported times depend on it, never a result.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// Asks the computation to stop at its next check.
    pub fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }

    /// Whether [`Control::cancel`] was called or the deadline has passed.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed) || self.is_overdue()
    }

    /// Ends the computation with an error when it was cancelled or is overdue.
    ///
    /// # Errors
    /// [`Cancelled`] when [`Control::cancel`] was called on this control or a clone, or the deadline has passed.
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }

    /// Reports the completed share of this stage, 0 to 1. The progress of the whole never falls.
    pub fn report(&self, fraction: f64) {
        let whole = self.from + fraction.clamp(0.0, 1.0) * (self.to - self.from);
        // The bit patterns of non-negative floats have the order of the floats.
        self.progress.fetch_max(whole.max(0.0).to_bits(), Ordering::Relaxed);
    }

    /// Progress of the whole work, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> f64 {
        f64::from_bits(self.progress.load(Ordering::Relaxed))
    }

    /// A control with the same cancel flag, clock and deadline whose progress does not count.
    #[must_use]
    pub fn without_progress(&self) -> Self {
        Self { progress: Arc::default(), from: 0.0, to: 1.0, ..self.clone() }
    }

    /// A control for a stage that covers the shares `from` to `to` (0 to 1) of this one.
    #[must_use]
    pub fn stage(&self, from: f64, to: f64) -> Self {
        let span = self.to - self.from;
        Self {
            cancel: Arc::clone(&self.cancel),
            progress: Arc::clone(&self.progress),
            from: self.from + from * span,
            to: self.from + to * span,
            clock: self.clock,
            deadline: self.deadline,
            memory_mb: self.memory_mb,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Control;

    #[test]
    fn a_stage_reports_its_share_of_the_whole_and_shares_the_cancel_flag() {
        let whole = Control::new();
        let stage = whole.stage(0.5, 1.0).stage(0.0, 0.5);
        stage.report(1.0);
        assert!((whole.progress() - 0.75).abs() < 1e-12);
        whole.cancel();
        assert!(stage.check().is_err());
    }

    #[test]
    fn what_is_overdue_counts_as_cancelled_in_every_stage() {
        let whole = Control::new().with_clock(|| 5.0);
        assert!(whole.check().is_ok() && !whole.is_overdue());
        let early = whole.clone().with_deadline(5.5);
        assert!(early.stage(0.0, 0.5).check().is_ok());
        let late = whole.with_deadline(5.0);
        assert!(late.stage(0.0, 0.5).check().is_err() && late.without_progress().check().is_err());
    }

    #[test]
    fn a_shorter_time_ends_a_part_and_not_the_whole() {
        let whole = Control::new().with_clock(|| 5.0).with_deadline(9.0);
        assert_eq!(whole.left_s(), 4.0);
        assert_eq!((whole.within(1.0).left_s(), whole.within(100.0).left_s()), (1.0, 4.0));
        assert!(whole.within(0.0).check().is_err() && whole.check().is_ok());
    }

    #[test]
    fn progress_never_falls() {
        let whole = Control::new();
        whole.stage(0.5, 1.0).report(0.5);
        for (from, to, fraction) in [(0.0, 0.5, 1.0), (0.75, 1.0, f64::NAN), (0.0, 1.0, -1.0)] {
            whole.stage(from, to).report(fraction);
            assert!((whole.progress() - 0.75).abs() < 1e-12);
        }
    }
}
