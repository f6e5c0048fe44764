/// One finished step of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRecord {
    /// Number, 1 to n.
    pub k: u32,
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Solver's report, JSON.
    pub document: String,
    /// Error statistics, JSON; `None` when the step is compared with nothing.
    pub error: Option<String>,
    /// Blob of the frame.
    pub blob: String,
    /// SHA-256 of the frame.
    pub sha256: String,
    /// Length of the frame.
    pub bytes: u64,
}

/// Result of storing a step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StepWritten {
    /// The step is stored. With the blob that it replaces, if any, which no row names any more.
    New(Option<String>),
    /// An earlier attempt stored the same frame: that frame stays, and no event is appended.
    Same,
}
