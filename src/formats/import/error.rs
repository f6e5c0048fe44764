use prosopon_geometry::GeometryError;

/// What an upload may at most hold; checked before anything is allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Triangles of a surface. Vertices may be three times as many.
    pub max_triangles: usize,
    /// Voxels of a volume.
    pub max_voxels: usize,
    /// Points and cells, each, of a volume mesh.
    pub max_cells: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_triangles: 20_000_000, max_voxels: 600_000_000, max_cells: 20_000_000 }
    }
}

/// Why bytes could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// No bytes at all.
    #[error("the file is empty")]
    Empty,
    /// The bytes are of no format that is read here.
    #[error("the format is not recognised; read are {expected}")]
    UnknownFormat {
        /// Formats that are read.
        expected: &'static str,
    },
    /// The bytes break the rules of their format.
    #[error("not a usable {format} file: {detail}")]
    Malformed {
        /// Format that was tried.
        format: &'static str,
        /// What was found and where.
        detail: String,
    },
    /// More elements than allowed.
    #[error("{found} {what}, but at most {allowed} are allowed")]
    TooLarge {
        /// What is counted.
        what: &'static str,
        /// How many the file holds.
        found: u64,
        /// How many are allowed.
        allowed: u64,
    },
    /// So small or large that the unit cannot be millimetres.
    #[error(
        "the box around everything measures {found_mm:?} mm across, expected {min_mm} to {max_mm} mm (a head has 100 to 600 mm): is the file in metres or another unit?"
    )]
    ImplausibleSize {
        /// Diagonal of the box if the file were in mm.
        found_mm: f64,
        /// Smallest diagonal that is read.
        min_mm: f64,
        /// Largest diagonal that is read.
        max_mm: f64,
    },
    /// Vertices and triangles do not make a mesh.
    #[error("the surface is not usable")]
    Geometry(#[from] GeometryError),
}

/// A breach of the rules of `format`.
pub(super) fn malformed(format: &'static str, detail: impl Into<String>) -> ImportError {
    ImportError::Malformed { format, detail: detail.into() }
}

/// Refuses more than `allowed` of `what`.
pub(super) fn at_most(what: &'static str, found: u64, allowed: usize) -> Result<(), ImportError> {
    let allowed = allowed as u64;
    if found > allowed { Err(ImportError::TooLarge { what, found, allowed }) } else { Ok(()) }
}

/// Refuses a size across that no unit mix-up short of mm explains, and warns of an unusual one.
pub(super) fn check_size(diagonal_mm: f64, warnings: &mut Vec<String>) -> Result<(), ImportError> {
    const READ: [f64; 2] = [1.0, 2_500.0];
    const USUAL: [f64; 2] = [50.0, 1500.0];
    let within = |range: [f64; 2]| range[0] <= diagonal_mm && diagonal_mm <= range[1];
    if !within(READ) {
        return Err(ImportError::ImplausibleSize { found_mm: diagonal_mm, min_mm: READ[0], max_mm: READ[1] });
    }
    if !within(USUAL) {
        warnings.push(format!(
            "the box around everything measures {diagonal_mm:.1} mm across; a head has 100 to 600 mm: check the unit"
        ));
    }
    Ok(())
}
