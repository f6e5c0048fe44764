//! Builds cells from connectivity, offsets and types.

use super::xml::{Section, VtkXml};
use super::{FORMAT, numbers};
use crate::import::ImportError;
use crate::import::error::malformed;
use prosopon_geometry::{Cell, Warning};

/// VTK's types of cells without volume: vertices, lines, triangles, quadrilaterals, linear and quadratic.
const CELLS_WITHOUT_VOLUME: [u32; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 21, 22, 23];
const TETRAHEDRON: u32 = 10;
const WEDGE: u32 = 13;
/// Most corners of a cell, including skipped ones; bounds the connectivity.
const MAX_CORNERS: usize = 27;

/// Types, ends (indices into `corners`) and corners of cells, unchecked.
pub(super) struct RawCells<'a> {
    pub(super) format: &'static str,
    pub(super) types: &'a [f64],
    pub(super) ends: &'a [f64],
    pub(super) corners: &'a [f64],
}

/// The tetrahedra and wedges of a file.
#[derive(Debug)]
pub(super) struct SolidCells {
    pub(super) cells: Vec<Cell>,
    /// For each cell of the file whether it was kept; `None` when all were.
    pub(super) kept: Option<Vec<bool>>,
}

impl SolidCells {
    /// Drops the values of cells that were left out; each cell of the file has `components` values.
    pub(super) fn kept_values(&self, values: Vec<f64>, components: usize) -> Vec<f64> {
        let Some(kept) = &self.kept else { return values };
        let rows = values.chunks_exact(components).zip(kept);
        rows.filter(|(_, kept)| **kept).flat_map(|(row, _)| row.iter().copied()).collect()
    }
}

/// The cells of a file with volume.
pub(super) fn read(file: &VtkXml<'_>, n_points: usize, warnings: &mut Vec<Warning>) -> Result<SolidCells, ImportError> {
    let fault = |detail: String| malformed(FORMAT, detail);
    let array = |name: &str| {
        let found = file.arrays.iter().find(|a| a.section == Section::Cells && a.name == name);
        found.ok_or_else(|| fault(format!("there is no array `{name}` of cells")))
    };
    let types = numbers(file, array("types")?, file.n_cells)?;
    let ends = numbers(file, array("offsets")?, file.n_cells)?;
    let last = ends.last().copied().unwrap_or(0.0);
    let length = whole(last)
        .filter(|n| *n as usize <= file.n_cells.saturating_mul(MAX_CORNERS))
        .ok_or_else(|| fault(format!("the last of `offsets` is {last}, which {} cells cannot reach", file.n_cells)))?;
    let corners = numbers(file, array("connectivity")?, length as usize)?;
    from_raw(&RawCells { format: FORMAT, types: &types, ends: &ends, corners: &corners }, n_points, warnings)
}

/// [`read`] from numbers that are already decoded.
pub(super) fn from_raw(
    raw: &RawCells<'_>,
    n_points: usize,
    warnings: &mut Vec<Warning>,
) -> Result<SolidCells, ImportError> {
    let fault = |detail: String| malformed(raw.format, detail);
    let mut cells = Vec::with_capacity(raw.types.len());
    let mut kept = vec![true; raw.types.len()];
    let mut begin = 0usize;
    for (index, ((&kind, &end), kept)) in raw.types.iter().zip(raw.ends).zip(&mut kept).enumerate() {
        let end = whole(end).map(|e| e as usize).filter(|e| *e >= begin);
        let mine = end.and_then(|end| raw.corners.get(begin..end));
        let (Some(end), Some(mine)) = (end, mine) else {
            return Err(fault(format!("`offsets` do not rise at cell {index}")));
        };
        begin = end;
        let kind = whole(kind).ok_or_else(|| fault(format!("the type of cell {index} is not a whole number")))?;
        let node = |c: &f64| {
            whole(*c)
                .filter(|n| (*n as usize) < n_points)
                .ok_or_else(|| fault(format!("cell {index} names the point {c}, but there are only {n_points}")))
        };
        let count = |n: usize| fault(format!("cell {index} has {} corners, expected {n}", mine.len()));
        match kind {
            TETRAHEDRON => {
                let &[a, b, c, d] = <&[f64; 4]>::try_from(mine).map_err(|_| count(4))?;
                cells.push(Cell::Tetrahedron([node(&a)?, node(&b)?, node(&c)?, node(&d)?]));
            }
            WEDGE => {
                let &[a, b, c, d, e, f] = <&[f64; 6]>::try_from(mine).map_err(|_| count(6))?;
                cells.push(Cell::Wedge([node(&a)?, node(&b)?, node(&c)?, node(&d)?, node(&e)?, node(&f)?]));
            }
            flat if CELLS_WITHOUT_VOLUME.contains(&flat) => *kept = false,
            other => {
                let detail = format!("cell {index} is of VTK's type {other}; expected tetrahedra (10) or wedges (13)");
                return Err(fault(detail));
            }
        }
    }
    let skipped = raw.types.len().saturating_sub(cells.len());
    if skipped == 0 {
        return Ok(SolidCells { cells, kept: None });
    }
    let found = format!("{skipped} cells without volume were left out");
    warnings.push(Warning::info("cells-without-volume", found));
    Ok(SolidCells { cells, kept: Some(kept) })
}

/// The value as `u32`; `None` unless it is a whole number in range.
pub(super) fn whole(value: f64) -> Option<u32> {
    (value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0).then_some(value as u32)
}
