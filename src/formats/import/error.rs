use prosopon_geometry::{GeometryError, Warning};

/// Largest numbers of elements that are read; checked before anything is allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Triangles of a surface; three times as many vertices are allowed.
    pub max_triangles: usize,
    /// Voxels of a volume.
    pub max_voxels: usize,
    /// Points of a volume mesh; the same number of cells is allowed.
    pub max_cells: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_triangles: 20_000_000, max_voxels: 600_000_000, max_cells: 20_000_000 }
    }
}

/// Reason why bytes could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// There are no bytes.
    #[error("the file is empty")]
    Empty,
    /// The bytes have no supported format.
    #[error("the format is not recognised; supported are {expected}")]
    UnknownFormat {
        /// Supported formats.
        expected: &'static str,
    },
    /// The bytes break the rules of their format.
    #[error("not a usable {format} file: {detail}")]
    Malformed {
        /// Format as which the bytes were read.
        format: &'static str,
        /// The fault and its position.
        detail: String,
    },
    /// The file holds more elements than allowed.
    #[error("{found} {what}, but at most {allowed} are allowed")]
    TooLarge {
        /// What is counted.
        what: &'static str,
        /// Number in the file.
        found: u64,
        /// Number allowed.
        allowed: u64,
    },
    /// The size is so small or large that the unit cannot be millimetres.
    #[error(
        "the bounding box has a diagonal of {found_mm:.1} mm, expected {min_mm} to {max_mm} mm (a head has 100 to 600 mm): \
         check whether the file is in metres or another unit"
    )]
    ImplausibleSize {
        /// Diagonal of the bounding box if the unit is mm.
        found_mm: f64,
        /// Smallest diagonal that is accepted.
        min_mm: f64,
        /// Largest diagonal that is accepted.
        max_mm: f64,
    },
    /// Vertices and triangles do not make a mesh.
    #[error("the surface is not usable")]
    Geometry(#[from] GeometryError),
}

impl ImportError {
    /// The same error; when the bytes of file `index` of an archive break the rules of their format, it names the file.
    pub(super) fn in_file(self, index: usize) -> Self {
        match self {
            Self::Malformed { format, detail } => {
                malformed(format, format!("file {}: {detail}", index.saturating_add(1)))
            }
            other @ (Self::Empty
            | Self::UnknownFormat { .. }
            | Self::TooLarge { .. }
            | Self::ImplausibleSize { .. }
            | Self::Geometry(_)) => other,
        }
    }
}

impl ImportError {
    /// The same error; when the bytes break the rules of their format, its detail ends with `more`.
    pub(super) fn adding(self, more: &str) -> Self {
        match self {
            Self::Malformed { format, detail } => malformed(format, format!("{detail}{more}")),
            other @ (Self::Empty
            | Self::UnknownFormat { .. }
            | Self::TooLarge { .. }
            | Self::ImplausibleSize { .. }
            | Self::Geometry(_)) => other,
        }
    }
}

/// The error of bytes that break the rules of `format`.
pub(super) fn malformed(format: &'static str, detail: impl Into<String>) -> ImportError {
    ImportError::Malformed { format, detail: detail.into() }
}

/// Refuses more than `allowed` of `what`.
pub(super) fn at_most(what: &'static str, found: u64, allowed: usize) -> Result<(), ImportError> {
    let allowed = allowed as u64;
    if found > allowed { Err(ImportError::TooLarge { what, found, allowed }) } else { Ok(()) }
}

/// Refuses a bounding-box diagonal (mm) that shows another unit than mm, and warns of an unusual one.
pub(super) fn check_size(diagonal_mm: f64, warnings: &mut Vec<Warning>) -> Result<(), ImportError> {
    const READ: [f64; 2] = [1.0, 2_500.0];
    const USUAL: [f64; 2] = [50.0, 1500.0];
    let within = |range: [f64; 2]| range[0] <= diagonal_mm && diagonal_mm <= range[1];
    if !within(READ) {
        return Err(ImportError::ImplausibleSize { found_mm: diagonal_mm, min_mm: READ[0], max_mm: READ[1] });
    }
    if !within(USUAL) {
        let found = format!("the bounding box has a diagonal of {diagonal_mm:.1} mm, but a head has 100 to 600 mm");
        warnings.push(Warning::check("unusual-size", found).act("Check that the file is in millimetres."));
    }
    Ok(())
}
