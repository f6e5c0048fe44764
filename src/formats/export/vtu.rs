use prosopon_geometry::{Cell, DataArray, Point, VolumeMesh};

/// VTK's types of the cells that are written.
const TETRA: u8 = 10;
const WEDGE: u8 = 13;

/// A VTU file (VTK's XML format) of tetrahedra and wedges, with raw appended data.
///
/// Cells are the tetrahedra in their order, then the wedges. Corners keep their order. The fourth corner of a tetrahedron
/// must lie on the side to which the normal of the first three points; the normal of the first triangle of a wedge must
/// point away from the second triangle. This is the order of VTK's file format guide and of meshio. VTK 9.7 has reversed the
/// order of its own wedge: it draws these wedges correctly, but measures their volume as negative.
///
/// An array on points or cells is its name, its number of components, and its values: `components` per point or cell. All
/// values are written as `Float64`.
///
/// # Panics
/// When an array does not have its components for each point or cell.
#[must_use]
pub fn vtu(
    positions: &[Point],
    tetrahedra: &[[u32; 4]],
    wedges: &[[u32; 6]],
    point_arrays: &[(&str, usize, &[f64])],
    cell_arrays: &[(&str, usize, &[f64])],
) -> Vec<u8> {
    let cells = tetrahedra.iter().map(|t| &t[..]).chain(wedges.iter().map(|w| &w[..]));
    vtu_of_cells(positions, &cells.collect::<Vec<_>>(), point_arrays, cell_arrays)
}

/// A VTU file of a volume mesh with all its arrays; cells keep their order.
///
/// # Panics
/// When an array does not have its components for each point or cell.
#[must_use]
pub fn vtu_of_mesh(mesh: &VolumeMesh) -> Vec<u8> {
    fn views(arrays: &[DataArray]) -> Vec<(&str, usize, &[f64])> {
        arrays.iter().map(|a| (a.name.as_str(), a.components, a.values.as_slice())).collect()
    }
    let cells: Vec<&[u32]> = mesh.cells.iter().map(Cell::corners).collect();
    vtu_of_cells(&mesh.points, &cells, &views(&mesh.point_arrays), &views(&mesh.cell_arrays))
}

/// [`vtu`] with cells in any order: of four corners (tetrahedra) or six (wedges).
///
/// # Panics
/// When an array has the wrong length, or a cell does not have 4 or 6 corners.
fn vtu_of_cells(
    positions: &[Point],
    cells: &[&[u32]],
    point_arrays: &[(&str, usize, &[f64])],
    cell_arrays: &[(&str, usize, &[f64])],
) -> Vec<u8> {
    let n_cells = cells.len();
    let mut file = VtkXmlWriter::default();
    file.xml(&format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{n_cells}\">\n",
        positions.len()
    ));

    file.xml("<Points>\n");
    file.array("Float64", "Points", 3, positions.iter().flat_map(|p| p.iter()).flat_map(|x| x.to_le_bytes()));
    file.xml("</Points>\n<Cells>\n");
    let corners = cells.iter().copied().flatten();
    file.array("Int64", "connectivity", 1, corners.flat_map(|v| i64::from(*v).to_le_bytes()));
    let mut end = 0;
    let ends = cells.iter().map(|c| {
        end += c.len();
        end
    });
    file.array("Int64", "offsets", 1, ends.flat_map(|end| (end as i64).to_le_bytes()));
    let types = cells.iter().map(|c| match c.len() {
        4 => TETRA,
        n => {
            assert_eq!(n, 6, "corners of a cell");
            WEDGE
        }
    });
    file.array("UInt8", "types", 1, types);
    file.xml("</Cells>\n<PointData>\n");
    for (name, components, values) in point_arrays {
        assert_eq!(values.len(), components * positions.len(), "values of {name}, of points and components");
        file.array("Float64", name, *components, values.iter().flat_map(|x| x.to_le_bytes()));
    }
    file.xml("</PointData>\n<CellData>\n");
    for (name, components, values) in cell_arrays {
        assert_eq!(values.len(), components * n_cells, "values of {name}, of cells and components");
        file.array("Float64", name, *components, values.iter().flat_map(|x| x.to_le_bytes()));
    }
    file.xml("</CellData>\n</Piece>\n</UnstructuredGrid>\n");
    file.finish()
}

/// A VTK XML file under construction: the XML part and the appended arrays.
#[derive(Default)]
pub(super) struct VtkXmlWriter {
    bytes: Vec<u8>,
    appended: Vec<u8>,
}

impl VtkXmlWriter {
    pub(super) fn xml(&mut self, text: &str) {
        self.bytes.extend(text.as_bytes());
    }

    /// Adds an array: its description to the XML, and its length in bytes (`u64`) and its bytes to the appended data.
    pub(super) fn array(&mut self, kind: &str, name: &str, components: usize, bytes: impl Iterator<Item = u8>) {
        let name = name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        let offset = self.appended.len();
        self.xml(&format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
             offset=\"{offset}\"/>\n"
        ));
        self.appended.extend([0; 8]);
        self.appended.extend(bytes);
        let length = (self.appended.len() - offset - 8) as u64;
        self.appended[offset..offset + 8].copy_from_slice(&length.to_le_bytes());
    }

    /// The complete file.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.xml("<AppendedData encoding=\"raw\">\n_");
        self.bytes.extend(self.appended);
        self.bytes.extend(b"\n</AppendedData>\n</VTKFile>\n");
        self.bytes
    }
}
