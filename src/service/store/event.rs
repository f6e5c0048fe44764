/// One event of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRecord {
    /// Counts up from 1 within the job.
    pub seq: u64,
    /// `status`, `progress`, `step`, `warning`, `resync` or `end`.
    pub kind: String,
    /// JSON.
    pub data: String,
}

/// Progress events that are kept of a job: the last ones tell all.
pub(super) const KEPT_PROGRESS: u64 = 100;
