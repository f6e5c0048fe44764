use std::time::Duration;

use super::memory::{allowed_mb, left_of_limits_mb, used_mb};
use prosopon_formats::import::Limits;
use prosopon_store::QueueLimits;

/// Limits and retention times of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServiceSettings {
    /// Largest number of waiting jobs of all tenants.
    pub max_waiting: u32,
    /// Largest number of waiting jobs of one tenant.
    pub max_waiting_tenant: u32,
    /// Number of workers of the heavy lane, each with its share of the threads.
    pub parallel_jobs: usize,
    /// Whether this process computes jobs, and not only other processes on the same store.
    pub computes_jobs: bool,
    /// Whether this process runs maintenance rounds.
    ///
    /// It must then have the retention times of the deployment.
    pub runs_maintenance: bool,
    /// Lease of a running job: after it, without renewal, another process may take the job over.
    pub lease: Duration,
    /// Number of attempts of a job before it fails.
    pub max_attempts: u32,
    /// Memory that this process may use, MB; `None` sets no limit.
    pub memory_mb: Option<u64>,
    /// Longest computing time of a job.
    pub max_wall: Duration,
    /// Time after which a computation that ignores its stop counts as stuck, and the process ends.
    pub stuck_after: Duration,
    /// Quota of a session, bytes.
    pub session_quota: u64,
    /// Bytes of the disk that are kept free for deletions and the ends of jobs.
    pub min_free: u64,
    /// Retention of unused sessions; `None` keeps them.
    pub session_retention: Option<Duration>,
    /// Time in which a deleted session can be restored; zero deletes it at once.
    pub deleted_retention: Duration,
    /// Retention of a job's events after its end.
    pub event_retention: Duration,
    /// Retention of a comparison's results after its end.
    pub comparison_retention: Duration,
    /// Time between two maintenance rounds.
    pub janitor_every: Duration,
    /// Limits of uploads.
    pub import: Limits,
}

impl Default for ServiceSettings {
    fn default() -> Self {
        const DAY: u64 = 24 * 3600;
        Self {
            max_waiting: 64,
            max_waiting_tenant: 64,
            parallel_jobs: 1,
            computes_jobs: true,
            runs_maintenance: true,
            lease: Duration::from_secs(3),
            max_attempts: 2,
            memory_mb: allowed_mb(),
            max_wall: Duration::from_secs(2 * 3600),
            stuck_after: Duration::from_secs(60),
            session_quota: 16 << 30,
            // Deleting every row of a database of some GB needs less, and so does the write-ahead log of SQLite.
            min_free: 256 << 20,
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
    /// Memory that a job that begins now may add to the memory in use, MB; its share at most.
    pub(super) fn memory_of_a_job_mb(&self) -> f64 {
        let parallel = self.parallel_jobs.max(1) as u64;
        let of_settings = self.memory_mb.zip(used_mb()).map(|(all, used)| all.saturating_sub(used).min(all / parallel));
        // Jobs that run already may map more, so each gets a part of what is left.
        let of_limits = left_of_limits_mb().map(|left| left / parallel);
        of_settings.into_iter().chain(of_limits).min().map_or(f64::INFINITY, |mb| mb as f64)
    }

    pub(super) fn queue(&self) -> QueueLimits {
        QueueLimits { all: self.max_waiting, tenant: self.max_waiting_tenant }
    }
}
