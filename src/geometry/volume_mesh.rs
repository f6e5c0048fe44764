use super::Point;

/// A volume element with its corners in the order of the file; the orientation is not checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cell {
    /// Tetrahedron, VTK cell type 10.
    Tetrahedron([u32; 4]),
    /// Wedge, VTK cell type 13: two triangles, with corner `i + 3` opposite corner `i`.
    Wedge([u32; 6]),
}

impl Cell {
    /// Point indices of the corners.
    #[must_use]
    pub fn corners(&self) -> &[u32] {
        match self {
            Self::Tetrahedron(corners) => corners,
            Self::Wedge(corners) => corners,
        }
    }
}

/// Named values on points or cells.
#[derive(Debug, Clone, PartialEq)]
pub struct DataArray {
    /// Name of the array.
    pub name: String,
    /// Number of values per point or cell.
    pub components: usize,
    /// All values, row-major: `components` values per point or cell.
    pub values: Vec<f64>,
}

/// A volume mesh of tetrahedra and wedges with arrays, as read from a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VolumeMesh {
    /// Points, taken as LPS mm. All are finite.
    pub points: Vec<Point>,
    /// Cells in the file's order; their corners are indices into `points`.
    pub cells: Vec<Cell>,
    /// Values on points.
    pub point_arrays: Vec<DataArray>,
    /// Values on cells.
    pub cell_arrays: Vec<DataArray>,
}

impl VolumeMesh {
    /// The point array named `name`.
    #[must_use]
    pub fn point_array(&self, name: &str) -> Option<&DataArray> {
        self.point_arrays.iter().find(|a| a.name == name)
    }

    /// The cell array named `name`.
    #[must_use]
    pub fn cell_array(&self, name: &str) -> Option<&DataArray> {
        self.cell_arrays.iter().find(|a| a.name == name)
    }
}
