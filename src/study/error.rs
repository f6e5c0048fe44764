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
    #[error("{} is not a readable surface", path.display())]
    Surface {
        /// The file.
        path: PathBuf,
        /// Why, when the format was recognised.
        source: Option<ImportError>,
    },
    /// A file or folder is not a CT.
    #[error("{} is not a readable CT", path.display())]
    Volume {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: ImportError,
    },
    /// No surfaces can be extracted from a CT.
    #[error("no surfaces can be extracted from {}", path.display())]
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
    /// The input is not usable for a study.
    #[error("the study cannot run: {detail}")]
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
    /// A measurement failed; measurements run in a separate process.
    #[error("the measurement of {case} failed: {detail}")]
    Row {
        /// What was measured.
        case: String,
        /// Its error message.
        detail: String,
    },
    /// A chart cannot be drawn.
    #[error("the chart cannot be drawn: {detail}")]
    Chart {
        /// Why.
        detail: String,
    },
    /// The bounding volume hierarchy of the comparison method cannot be built.
    #[error("the bounding volume hierarchy of the surface cannot be built: {detail}")]
    Hierarchy {
        /// Why.
        detail: String,
    },
    /// Stopped by the caller.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// A result cannot be printed.
    #[error("cannot print the result")]
    Print(#[from] std::io::Error),
}

/// What is wrong with a file of points.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PointsFault {
    /// The file is too short for the count.
    #[error("the file has {found} bytes, but a file of points starts with a count of 8 bytes (u64, little-endian)")]
    NoCount {
        /// Length, bytes.
        found: usize,
    },
    /// The count does not match the length.
    #[error("the count says {count} points, which need {needed} bytes, but the file has {found}")]
    Length {
        /// Number of points according to the count.
        count: u64,
        /// Bytes that these points need.
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

/// Reads a whole file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, BenchError> {
    std::fs::read(path).map_err(|source| BenchError::File { what: "read", path: path.to_owned(), source })
}

/// Writes a whole file.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    std::fs::write(path, bytes).map_err(|source| BenchError::File { what: "write", path: path.to_owned(), source })
}
