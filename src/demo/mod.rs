//! `prosopon demo`: starts the service and uses it over HTTP as a front-end does.
//!
//! Invariants: it uses only the public API of the service; it writes only answers of the service and pictures of them.

mod case;
mod client;
mod output;
mod patient;

use std::path::PathBuf;

pub use case::run;
pub use output::clear;

/// Arguments of `prosopon demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// Head CT: DICOM series (zip or folder), NIfTI, NRRD, MetaImage [default without --skin: the generated phantom head].
    #[arg(long, conflicts_with_all = ["skin", "skull"])]
    pub ct: Option<PathBuf>,
    /// Skin surface (STL, PLY, OBJ, VTP); needs --skull.
    #[arg(long, requires = "skull")]
    pub skin: Option<PathBuf>,
    /// Skull surface (STL, PLY, OBJ, VTP); needs --skin.
    #[arg(long, requires = "skin")]
    pub skull: Option<PathBuf>,
    /// JSON with landmarks and Le Fort I plane [default: `landmarks.json` next to the input, if it exists].
    #[arg(long)]
    pub landmarks: Option<PathBuf>,
    /// Folder for the results.
    #[arg(long, default_value = "prosopon-demo")]
    pub out: PathBuf,
    /// Forward movement of the maxilla, mm (negative is a set-back).
    #[arg(long, default_value_t = 6.0, allow_negative_numbers = true)]
    pub forward_mm: f64,
    /// Downward movement of the maxilla, mm.
    #[arg(long, default_value_t = 1.5, allow_negative_numbers = true)]
    pub down_mm: f64,
    /// Number of streamed steps.
    #[arg(long, default_value_t = 6)]
    pub steps: usize,
    /// Mechanical model: auto, linear, mass_tensor, nonlinear or mixed.
    #[arg(long, default_value = "auto")]
    pub model: String,
    /// Edge length of the tetrahedra, mm [default: that of the service].
    #[arg(long)]
    pub edge_mm: Option<f64>,
    /// The lips part, where the crease between them is found.
    #[arg(long)]
    pub part_lips: bool,
    /// Skip the second job (linear model) and its error map.
    #[arg(long)]
    pub no_compare: bool,
    /// Keep the server running at the end.
    #[arg(long)]
    pub keep: bool,
}

/// Why the demo stopped.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The service answered with a problem.
    #[error("{method} {path}: {status} {title}: {detail}")]
    Problem {
        /// HTTP method.
        method: &'static str,
        /// Path that was called.
        path: String,
        /// HTTP status.
        status: u16,
        /// The problem's title.
        title: String,
        /// The problem's detail.
        detail: String,
    },
    /// The service could not be reached, or the connection broke.
    #[error("the service could not be reached or the connection broke")]
    Http(#[from] ureq::Error),
    /// The service's answer lacks something.
    #[error("the answer to {path} has no usable `{field}`")]
    Answer {
        /// Path that was called.
        path: String,
        /// The field that is missing.
        field: &'static str,
    },
    /// A file could not be read or written.
    #[error("{path}")]
    File {
        /// The file.
        path: String,
        /// Reason.
        source: std::io::Error,
    },
    /// The CT could not be read.
    #[error("the CT could not be read")]
    Ct(#[from] prosopon_study::BenchError),
    /// A landmarks file is not usable.
    #[error("the landmarks in {path} are not usable: {detail}")]
    Landmarks {
        /// The file.
        path: String,
        /// What is wrong.
        detail: String,
    },
    /// A job ended without success.
    #[error("the {kind} job ended as {status}: {detail}")]
    Job {
        /// Kind of job.
        kind: &'static str,
        /// Its last status.
        status: String,
        /// Reason given.
        detail: String,
    },
}

impl DemoError {
    fn file(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::File { path: path.display().to_string(), source }
    }
}
