/// One finished step of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct StepRecord {
    /// Number, 1 to n.
    pub k: u32,
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// Solver's report, JSON.
    pub document: String,
    /// Error statistics, JSON, where there is something to compare with.
    pub error: Option<String>,
    /// Blob of the frame.
    pub blob: String,
    /// SHA-256 of the frame.
    pub sha256: String,
    /// Length of the frame.
    pub bytes: u64,
}

/// What came of storing a step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StepWritten {
    /// It is visible now; the blob that it replaces, where there was one, is not named any more.
    New(Option<String>),
    /// An earlier attempt left the same frame: that one stays, and nothing is told again.
    Same,
}
