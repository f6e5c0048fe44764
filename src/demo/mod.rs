//! `prosopon demo`: starts the service and drives it over HTTP as a front-end would.
//!
//! Invariants: talks to the service through its public API only; what it writes to disk is what the service answered,
//! and pictures of it.

mod case;
mod client;
mod output;
mod patient;

use std::path::PathBuf;

pub use case::run;
pub use output::clear;

/// What `prosopon demo` is asked to do.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// Head CT to plan on: DICOM series (zip or folder), NIfTI, NRRD, MetaImage; the generated phantom head when neither this nor --skin is given.
    #[arg(long, conflicts_with_all = ["skin", "skull"])]
    pub ct: Option<PathBuf>,
    /// Skin surface (STL, PLY, OBJ, VTP), with --skull.
    #[arg(long, requires = "skull")]
    pub skin: Option<PathBuf>,
    /// Skull surface (STL, PLY, OBJ, VTP), with --skin.
    #[arg(long, requires = "skin")]
    pub skull: Option<PathBuf>,
    /// Landmarks and Le Fort I plane; `landmarks.json` beside the input is picked up by itself.
    #[arg(long)]
    pub landmarks: Option<PathBuf>,
    /// Where results go.
    #[arg(long, default_value = "prosopon-demo")]
    pub out: PathBuf,
    /// Forward movement of the maxilla, mm (negative is a set-back).
    #[arg(long, default_value_t = 6.0, allow_negative_numbers = true)]
    pub forward_mm: f64,
    /// Downward movement of the maxilla, mm.
    #[arg(long, default_value_t = 1.5, allow_negative_numbers = true)]
    pub down_mm: f64,
    /// Streamed steps.
    #[arg(long, default_value_t = 6)]
    pub steps: usize,
    /// Model: auto, linear or mixed.
    #[arg(long, default_value = "mixed")]
    pub model: String,
    /// Edge of the tetrahedra, mm; the service's default when absent.
    #[arg(long)]
    pub edge_mm: Option<f64>,
    /// Skip the second job (linear model) that the error map compares with.
    #[arg(long)]
    pub no_compare: bool,
    /// Leave the server up at the end.
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
    /// The service could not be reached or broke off.
    #[error("the service could not be reached")]
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
    #[error("landmarks in {path} are not usable: {detail}")]
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
