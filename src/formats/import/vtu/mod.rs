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
pub use legacy::is_legacy_vtk;
pub(super) use polydata::{looks_like_polydata, read_polydata};
use prosopon_geometry::{Aabb, Cell, DataArray, Point, VolumeMesh};
use xml::{File, Grid, RawArray, Section};

const FORMAT: &str = "VTK XML";

/// Reads a volume mesh from a VTU file or a legacy VTK file.
///
/// VTU data may be ASCII, base64 or raw appended, plain or compressed by zlib; legacy files may be ASCII or binary. Returns
/// the mesh and warnings about omitted content (cells of lower dimension, arrays of text).
///
/// # Errors
/// [`ImportError`] with the fault and its position; among others for cells that are neither tetrahedra nor wedges, for
/// several pieces, and for other compressors.
pub fn volume_mesh(bytes: &[u8], limits: &Limits) -> Result<(VolumeMesh, Vec<String>), ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::Empty);
    }
    if is_legacy_vtk(bytes) {
        return legacy::read(bytes, limits);
    }
    let file = File::parse(bytes, Grid::UnstructuredGrid)?;
    at_most("points", file.n_points as u64, limits.max_cells)?;
    at_most("cells", file.n_cells as u64, limits.max_cells)?;
    let mut warnings = Vec::new();
    let points = points(&file)?;
    let (cells, kept) = cells::read(&file, points.len(), &mut warnings)?;
    let point_arrays = arrays(&file, Section::PointData, file.n_points, None, &mut warnings)?;
    let cell_arrays = arrays(&file, Section::CellData, file.n_cells, kept.as_deref(), &mut warnings)?;
    Ok(finished(VolumeMesh { points, cells, point_arrays, cell_arrays }, warnings))
}

/// The mesh with warnings about unused points and an unusual size.
///
/// The size is only a warning, since a test body may have any size. Unused points do not count towards it.
fn finished(mesh: VolumeMesh, mut warnings: Vec<String>) -> (VolumeMesh, Vec<String>) {
    let mut used: Vec<u32> = mesh.cells.iter().flat_map(Cell::corners).copied().collect();
    used.sort_unstable();
    used.dedup();
    let unused = mesh.points.len().saturating_sub(used.len());
    if unused > 0 {
        warnings.push(format!("{unused} points belong to no tetrahedron and no wedge: they will not move"));
    }
    let points: Vec<Point> = used.iter().filter_map(|n| mesh.points.get(*n as usize)).copied().collect();
    let size = Aabb::of(&points).map_or(0.0, |b| b.diagonal());
    if let Err(unusual) = check_size(size, &mut warnings) {
        warnings.push(unusual.to_string());
    }
    (mesh, warnings)
}

fn points(file: &File<'_>) -> Result<Vec<Point>, ImportError> {
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
fn numbers(file: &File<'_>, array: &RawArray<'_>, n: usize) -> Result<Vec<f64>, ImportError> {
    let values = decode::numbers(file, array, n)?;
    if values.len() == n {
        return Ok(values);
    }
    let detail = format!("{} holds {} numbers, expected {n}", array.place(), values.len());
    Err(malformed(FORMAT, detail))
}

/// The arrays of a section; `kept` marks the cells that are read.
fn arrays(
    file: &File<'_>,
    section: Section,
    n: usize,
    kept: Option<&[bool]>,
    warnings: &mut Vec<String>,
) -> Result<Vec<DataArray>, ImportError> {
    let mut found: Vec<DataArray> = Vec::new();
    for array in file.arrays.iter().filter(|a| a.section == section) {
        if array.kind.is_none() {
            warnings.push(format!("{} holds no numbers and was left out", array.place()));
            continue;
        }
        if found.iter().any(|a| a.name == array.name) {
            return Err(malformed(FORMAT, format!("{} has the same name as an earlier one", array.place())));
        }
        let components = array.components;
        let mut values = numbers(file, array, n.saturating_mul(components))?;
        if let Some(kept) = kept {
            let rows = values.chunks_exact(components).zip(kept);
            values = rows.filter(|(_, kept)| **kept).flat_map(|(row, _)| row.iter().copied()).collect();
        }
        found.push(DataArray { name: array.name.clone(), components, values });
    }
    Ok(found)
}
