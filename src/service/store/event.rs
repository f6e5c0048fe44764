/// One event of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRecord {
    /// Counts up from 1 within the job.
    pub seq: u64,
    /// `status`, `progress`, `step`, `warning`, `resync` or `end`.
    pub kind: String,
    /// Content, JSON.
    pub data: String,
}

/// Number of a job's last events among which progress events are kept; older ones are outdated.
pub(super) const KEPT_PROGRESS: u64 = 100;
