use super::Point;

/// A volume element as its file has it; corners are in the file's order, whatever its orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cell {
    /// VTK's type 10.
    Tetrahedron([u32; 4]),
    /// VTK's type 13: two triangles, corner `i + 3` beside corner `i`.
    Wedge([u32; 6]),
}

impl Cell {
    /// Its corners.
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
    /// Name.
    pub name: String,
    /// Values a point or cell.
    pub components: usize,
    /// All values, those of one point or cell side by side.
    pub values: Vec<f64>,
}

/// A volume mesh as a file has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VolumeMesh {
    /// Points, taken as LPS mm. All are finite.
    pub points: Vec<Point>,
    /// Cells in the file's order; their corners are points.
    pub cells: Vec<Cell>,
    /// Values on points.
    pub point_arrays: Vec<DataArray>,
    /// Values on cells.
    pub cell_arrays: Vec<DataArray>,
}

impl VolumeMesh {
    /// The point array of that name.
    #[must_use]
    pub fn point_array(&self, name: &str) -> Option<&DataArray> {
        self.point_arrays.iter().find(|a| a.name == name)
    }

    /// The cell array of that name.
    #[must_use]
    pub fn cell_array(&self, name: &str) -> Option<&DataArray> {
        self.cell_arrays.iter().find(|a| a.name == name)
    }
}
