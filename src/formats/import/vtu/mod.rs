//! Reads VTK files: volume meshes (XML `.vtu`, legacy `.vtk`) and surfaces (XML `.vtp`).

mod cells;
mod decode;
mod legacy;
#[cfg(test)]
pub(super) mod legacy_tests;
mod polydata;
#[cfg(test)]
pub(super) mod tests;
mod xml;

use super::error::{at_most, check_size, malformed};
use super::{ImportError, Limits};
use cells::SolidCells;
pub use legacy::is_legacy_vtk;
pub(super) use polydata::{looks_like_polydata, read_polydata};
use prosopon_geometry::{Aabb, Cell, DataArray, Point, VolumeMesh, Warning};
use xml::{Grid, RawArray, Section, VtkXml};

const FORMAT: &str = "VTK XML";

/// Reads a volume mesh from a VTU file or a legacy VTK file.
///
/// VTU data may be ASCII, base64 or raw appended, plain or compressed by zlib; legacy files may be ASCII or binary. Returns
/// the mesh and warnings about omitted content (cells of lower dimension, arrays of text).
///
/// # Errors
/// [`ImportError`] with the fault and its position; among others for cells that are neither tetrahedra nor wedges, for
/// several pieces, and for other compressors.
pub fn volume_mesh(bytes: &[u8], limits: &Limits) -> Result<(VolumeMesh, Vec<Warning>), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    if is_legacy_vtk(bytes) {
        return legacy::read(bytes, limits);
    }
    let file = VtkXml::parse(bytes, Grid::UnstructuredGrid)?;
    at_most("points", file.n_points as u64, limits.max_cells)?;
    at_most("cells", file.n_cells as u64, limits.max_cells)?;
    let mut warnings = Vec::new();
    let points = points(&file)?;
    let found = cells::read(&file, points.len(), &mut warnings)?;
    let point_arrays = arrays(&file, Section::PointData, file.n_points, None, &mut warnings)?;
    let cell_arrays = arrays(&file, Section::CellData, file.n_cells, Some(&found), &mut warnings)?;
    Ok(with_warnings(VolumeMesh { points, cells: found.cells, point_arrays, cell_arrays }, warnings))
}

/// The mesh with warnings about unused points and an unusual size.
///
/// The size is only a warning, since a test body may have any size. Unused points do not count towards it.
fn with_warnings(mesh: VolumeMesh, mut warnings: Vec<Warning>) -> (VolumeMesh, Vec<Warning>) {
    let mut used: Vec<u32> = mesh.cells.iter().flat_map(Cell::corners).copied().collect();
    used.sort_unstable();
    used.dedup();
    let unused = mesh.points.len().saturating_sub(used.len());
    if unused > 0 {
        let found = format!("{unused} points belong to no tetrahedron and no wedge and will not move");
        warnings.push(Warning::info("points-without-cell", found));
    }
    let points: Vec<Point> = used.iter().filter_map(|n| mesh.points.get(*n as usize)).copied().collect();
    let size = Aabb::of(&points).map_or(0.0, |b| b.diagonal());
    if check_size(size, &mut warnings).is_err() {
        let found = format!("the bounding box has a diagonal of {size:?} mm, but a head has 100 to 600 mm");
        warnings.push(
            Warning::check("implausible-size", found).act("Check whether the file is in metres or another unit."),
        );
    }
    (mesh, warnings)
}

fn points(file: &VtkXml<'_>) -> Result<Vec<Point>, ImportError> {
    let array = file
        .arrays
        .iter()
        .find(|a| a.section == Section::Points)
        .ok_or_else(|| malformed(FORMAT, "there is no array of points"))?;
    if array.components != 3 {
        return Err(malformed(FORMAT, format!("points have {} components, expected 3", array.components)));
    }
    points_from(FORMAT, &numbers(file, array, file.n_points.saturating_mul(3))?)
}

/// Points from their coordinates, three per point.
fn points_from(format: &'static str, coordinates: &[f64]) -> Result<Vec<Point>, ImportError> {
    let (points, _) = coordinates.as_chunks::<3>();
    match points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        Some(point) => Err(malformed(format, format!("point {point} has a coordinate that is not finite"))),
        None => Ok(points.iter().map(|&p| Point::from(p)).collect()),
    }
}

/// The numbers of an array, which must be exactly `n`.
fn numbers(file: &VtkXml<'_>, array: &RawArray<'_>, n: usize) -> Result<Vec<f64>, ImportError> {
    let values = decode::numbers(file, array, n)?;
    if values.len() == n {
        return Ok(values);
    }
    let detail = format!("{} holds {} numbers, expected {n}", array.place(), values.len());
    Err(malformed(FORMAT, detail))
}

/// The arrays of a section; for data of cells, `cells` are those that are read.
fn arrays(
    file: &VtkXml<'_>,
    section: Section,
    n: usize,
    cells: Option<&SolidCells>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<DataArray>, ImportError> {
    let mut found: Vec<DataArray> = Vec::new();
    for array in file.arrays.iter().filter(|a| a.section == section) {
        if array.number_type.is_none() {
            let found = format!("{} holds no numbers and was left out", array.place());
            warnings.push(Warning::info("array-without-numbers", found));
            continue;
        }
        if found.iter().any(|a| a.name == array.name) {
            return Err(malformed(FORMAT, format!("{} has the same name as an earlier one", array.place())));
        }
        let components = array.components;
        let values = numbers(file, array, n.saturating_mul(components))?;
        let values = match cells {
            Some(cells) => cells.kept_values(values, components),
            None => values,
        };
        found.push(DataArray { name: array.name.clone(), components, values });
    }
    Ok(found)
}
