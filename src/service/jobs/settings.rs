use std::time::Duration;

use super::memory::{allowed_mb, used_mb};
use prosopon_formats::import::Limits;
use prosopon_store::QueueLimits;

/// Bounds of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServiceSettings {
    /// Jobs that may wait in all.
    pub max_waiting: u32,
    /// Jobs of one tenant that may wait.
    pub max_waiting_tenant: u32,
    /// Jobs of minutes that are computed at the same time, each with its share of the threads.
    pub parallel_jobs: usize,
    /// Whether jobs are computed here, and not only by other processes on the same store.
    pub works: bool,
    /// Whether what has expired is removed here: by processes that are told what that is, which workers need not be.
    pub keeps_house: bool,
    /// A running job of which nothing was heard for so long is given to another process.
    pub lease: Duration,
    /// Times that a job is started before it is given up.
    pub max_attempts: u32,
    /// Memory that this process may use, MB; without it jobs are not held back.
    pub memory_mb: Option<u64>,
    /// Longest that a job may compute.
    pub max_wall: Duration,
    /// Bytes that a session may store.
    pub session_quota: u64,
    /// Sessions in which nothing happens for so long are deleted; never when absent.
    pub session_retention: Option<Duration>,
    /// A deleted session can be restored for so long; then it goes for good. Zero: at once.
    pub deleted_retention: Duration,
    /// Events of a job are kept for so long after its end.
    pub event_retention: Duration,
    /// Results of a comparison are kept for so long after its end.
    pub comparison_retention: Duration,
    /// Time between two rounds of the janitor.
    pub janitor_every: Duration,
    /// What an upload may hold.
    pub import: Limits,
}

impl Default for ServiceSettings {
    fn default() -> Self {
        const DAY: u64 = 24 * 3600;
        Self {
            max_waiting: 64,
            max_waiting_tenant: 64,
            parallel_jobs: 1,
            works: true,
            keeps_house: true,
            lease: Duration::from_secs(15),
            max_attempts: 2,
            memory_mb: allowed_mb(),
            max_wall: Duration::from_secs(2 * 3600),
            session_quota: 16 << 30,
            session_retention: None,
            deleted_retention: Duration::from_secs(DAY),
            event_retention: Duration::from_secs(30 * DAY),
            comparison_retention: Duration::from_secs(30 * DAY),
            janitor_every: Duration::from_secs(600),
            import: Limits::default(),
        }
    }
}

impl ServiceSettings {
    /// What a job that begins now may take beside what is in use, MB; of several at a time each its share at most.
    pub(super) fn memory_of_a_job_mb(&self) -> f64 {
        let Some((all, used)) = self.memory_mb.zip(used_mb()) else { return f64::INFINITY };
        let share = all / self.parallel_jobs.max(1) as u64;
        all.saturating_sub(used).min(share) as f64
    }

    pub(super) fn queue(&self) -> QueueLimits {
        QueueLimits { all: self.max_waiting, tenant: self.max_waiting_tenant }
    }
}
