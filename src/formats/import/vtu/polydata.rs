//! Reads surfaces of polygons and triangle strips.

use super::cells::whole;
use super::xml::{Grid, Section, VtkXml};
use super::{FORMAT, numbers, points};
use crate::import::error::{at_most, malformed};
use crate::import::raw_surface::{Faces, RawSurface};
use crate::import::{ImportError, Limits};
use prosopon_geometry::Point;

/// Most corners per face on average; bounds the connectivity.
const MAX_CORNERS: usize = 64;

/// Whether these may be the bytes of a VTP file.
pub(in crate::import) fn looks_like_polydata(bytes: &[u8]) -> bool {
    let beginning = bytes.get(..bytes.len().min(1024)).unwrap_or_default();
    let has = |word: &[u8]| beginning.windows(word.len()).any(|w| w == word);
    bytes.trim_ascii_start().starts_with(b"<") && has(b"<VTKFile") && has(b"PolyData")
}

/// Reads a VTP file.
pub(in crate::import) fn read_polydata(bytes: &[u8], limits: &Limits) -> Result<RawSurface, ImportError> {
    let file = VtkXml::parse(bytes, Grid::PolyData)?;
    at_most("points", file.n_points as u64, limits.max_triangles.saturating_mul(3))?;
    at_most("polygons", (file.n_cells as u64).saturating_add(file.n_strips as u64), limits.max_triangles)?;
    let positions = points(&file)?;
    let mut faces = Faces::new(FORMAT, limits);
    each_face(&file, Section::Polys, file.n_cells, &mut |corners| faces.push(&positions, corners))?;
    each_face(&file, Section::Strips, file.n_strips, &mut |strip| push_strip(&mut faces, &positions, strip))?;
    Ok(faces.finish(positions))
}

/// Adds the triangles of a strip; every second one has the opposite order of corners.
fn push_strip(faces: &mut Faces, positions: &[Point], strip: &[u32]) -> Result<(), ImportError> {
    for (at, corners) in strip.windows(3).enumerate() {
        if let &[a, b, c] = corners {
            faces.push(positions, &if at % 2 == 0 { [a, b, c] } else { [b, a, c] })?;
        }
    }
    Ok(())
}

fn each_face(
    file: &VtkXml<'_>,
    section: Section,
    n: usize,
    take: &mut dyn FnMut(&[u32]) -> Result<(), ImportError>,
) -> Result<(), ImportError> {
    if n == 0 {
        return Ok(());
    }
    let fault = |detail: String| malformed(FORMAT, detail);
    let array = |name: &str| {
        let found = file.arrays.iter().find(|a| a.section == section && a.name == name);
        found.ok_or_else(|| fault(format!("there is no array `{name}` of {section:?}")))
    };
    let ends = numbers(file, array("offsets")?, n)?;
    let last = ends.last().copied().unwrap_or(0.0);
    let length = whole(last)
        .filter(|l| *l as usize <= n.saturating_mul(MAX_CORNERS))
        .ok_or_else(|| fault(format!("the last of `offsets` is {last}, which {n} faces cannot reach")))?;
    let connectivity = numbers(file, array("connectivity")?, length as usize)?;
    let corners: Option<Vec<u32>> = connectivity.into_iter().map(whole).collect();
    let corners = corners.ok_or_else(|| fault(format!("a corner of {section:?} is not an index")))?;
    let mut begin = 0usize;
    for (index, &end) in ends.iter().enumerate() {
        let end = whole(end).map(|e| e as usize);
        let Some((end, face)) = end.and_then(|end| Some((end, corners.get(begin..end)?))) else {
            return Err(fault(format!("`offsets` do not rise at face {index}")));
        };
        take(face)?;
        begin = end;
    }
    Ok(())
}
