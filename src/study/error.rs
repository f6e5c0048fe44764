use std::path::{Path, PathBuf};

use prosopon_field::FieldError;
use prosopon_formats::import::ImportError;
use prosopon_geometry::control::Cancelled;
use prosopon_planning::evaluate::EvaluateError;
use prosopon_planning::simulate::SimulateError;
use prosopon_planning::surface::SurfaceError;

/// Why a study stopped.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A file cannot be read or written.
    #[error("cannot {what} {}", path.display())]
    File {
        /// Read, write.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file is not a surface.
    #[error("{} is not a surface that can be read", path.display())]
    Surface {
        /// The file.
        path: PathBuf,
        /// Why, when the format was recognised.
        source: Option<ImportError>,
    },
    /// A file or folder is not a CT.
    #[error("{} is not a CT that can be read", path.display())]
    Volume {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: ImportError,
    },
    /// No surfaces come of a CT.
    #[error("no surfaces come of {}", path.display())]
    Ct {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: SurfaceError,
    },
    /// A file is not a list of points.
    #[error("{}: {fault}", path.display())]
    Points {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: PointsFault,
    },
    /// A file of landmarks is not usable.
    #[error("{}: {detail}", path.display())]
    Landmarks {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        detail: String,
    },
    /// A head is not usable for a study.
    #[error("the study cannot be made: {detail}")]
    Head {
        /// What is wrong.
        detail: String,
    },
    /// Surfaces cannot be compared.
    #[error("the surfaces cannot be compared")]
    Evaluate(#[from] EvaluateError),
    /// The scene cannot be built.
    #[error("the scene cannot be built")]
    Scene(#[from] SimulateError),
    /// The field cannot be built.
    #[error("the {method} field cannot be built")]
    Field {
        /// Method.
        method: &'static str,
        /// Why.
        source: FieldError,
    },
    /// A measurement, which runs as a program of its own, failed.
    #[error("the measurement of {case} failed: {detail}")]
    Row {
        /// What was measured.
        case: String,
        /// What it said.
        detail: String,
    },
    /// A chart cannot be drawn.
    #[error("the chart cannot be drawn: {detail}")]
    Chart {
        /// Why.
        detail: String,
    },
    /// The comparison's own hierarchy cannot be built.
    #[error("no hierarchy over the surface: {detail}")]
    Hierarchy {
        /// Why.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A result cannot be printed.
    #[error("cannot print")]
    Print(#[from] std::io::Error),
}

/// What is wrong with a file of points.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PointsFault {
    /// Not even a count.
    #[error("{found} bytes are no file of points: it starts with a count of 8 bytes, little-endian")]
    NoCount {
        /// Length, bytes.
        found: usize,
    },
    /// The count does not match the length.
    #[error("it announces {count} points and so {needed} bytes, but has {found}")]
    Length {
        /// Announced points.
        count: u64,
        /// Bytes that takes.
        needed: u128,
        /// Length, bytes.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} has a coordinate that is not finite")]
    NotFinite {
        /// First such point, from 0.
        index: usize,
    },
}

/// Reads a file whole.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, BenchError> {
    std::fs::read(path).map_err(|source| BenchError::File { what: "read", path: path.to_owned(), source })
}

/// Writes a file whole.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    std::fs::write(path, bytes).map_err(|source| BenchError::File { what: "write", path: path.to_owned(), source })
}
