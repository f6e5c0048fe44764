//! Files of surfaces, landmarks, points and distances.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::{BenchError, PointsFault, read, write};
use prosopon_formats::import::{Limits, detect_surface, surface};
use prosopon_geometry::{Point, TriMesh};
use prosopon_planning::plan::Landmarks;

#[derive(Deserialize)]
struct LandmarksFile {
    #[serde(alias = "landmarks")]
    points: BTreeMap<String, [f64; 3]>,
    midline_x_mm: Option<f64>,
    occlusal_plane_z_mm: Option<f64>,
    le_fort_1_plane: Option<PlaneFile>,
}

#[derive(Deserialize)]
struct PlaneFile {
    #[serde(alias = "point")]
    point_mm: [f64; 3],
    normal: [f64; 3],
}

/// Reads `landmarks.json`.
pub(super) fn read_landmarks(path: &Path) -> Result<Landmarks, BenchError> {
    let file: LandmarksFile = serde_json::from_slice(&read(path)?)
        .map_err(|e| BenchError::Landmarks { path: path.to_owned(), detail: e.to_string() })?;
    Ok(Landmarks {
        points: file.points.into_iter().map(|(name, p)| (name, Point::from(p))).collect(),
        midline_x_mm: file.midline_x_mm,
        occlusal_z_mm: file.occlusal_plane_z_mm,
        le_fort_1_plane: file.le_fort_1_plane.map(|p| (p.point_mm.into(), p.normal.into())),
    })
}

/// Reads a surface (STL, PLY, OBJ or VTP).
pub(super) fn read_surface(path: &Path) -> Result<TriMesh, BenchError> {
    let refused = |source| BenchError::Surface { path: path.to_owned(), source };
    let bytes = read(path)?;
    let format = detect_surface(&bytes).ok_or_else(|| refused(None))?;
    Ok(surface(&bytes, format, &Limits::default()).map_err(|e| refused(Some(e)))?.0)
}

/// Reads points: their number (u64), then x, y, z of each (f64), little-endian, LPS mm.
pub(super) fn read_points(path: &Path) -> Result<Vec<Point>, BenchError> {
    points(&read(path)?).map_err(|fault| BenchError::Points { path: path.to_owned(), fault })
}

/// Writes points in the format of [`read_points`].
pub(super) fn write_points<'a>(
    path: &Path,
    points: impl ExactSizeIterator<Item = &'a Point>,
) -> Result<(), BenchError> {
    let mut bytes = (points.len() as u64).to_le_bytes().to_vec();
    bytes.extend(points.flat_map(|p| p.coords.data.0[0]).flat_map(f64::to_le_bytes));
    write(path, &bytes)
}

/// Writes a surface for other programs, little-endian.
///
/// The file holds the numbers of vertices and triangles (u64), then x, y, z of each vertex (f64, LPS mm) and the three vertex
/// indices of each triangle (u32).
pub(super) fn write_triangles(path: &Path, mesh: &TriMesh) -> Result<(), BenchError> {
    let counts = [mesh.positions().len() as u64, mesh.triangles().len() as u64];
    let mut bytes: Vec<u8> = counts.into_iter().flat_map(u64::to_le_bytes).collect();
    bytes.extend(mesh.positions().iter().flat_map(|p| p.coords.data.0[0]).flat_map(f64::to_le_bytes));
    bytes.extend(mesh.triangles().iter().flatten().copied().flat_map(u32::to_le_bytes));
    write(path, &bytes)
}

/// Writes numbers as f64, little-endian, without a header.
pub(super) fn write_distances(path: &Path, distances: &[f64]) -> Result<(), BenchError> {
    let bytes: Vec<u8> = distances.iter().flat_map(|d| d.to_le_bytes()).collect();
    write(path, &bytes)
}

/// Reads a file written by [`write_distances`].
pub(super) fn read_distances(path: &Path) -> Result<Vec<f64>, BenchError> {
    Ok(numbers(&read(path)?))
}

fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
}

fn points(bytes: &[u8]) -> Result<Vec<Point>, PointsFault> {
    let Some((count, rest)) = bytes.split_first_chunk::<8>() else {
        return Err(PointsFault::NoCount { found: bytes.len() });
    };
    let count = u64::from_le_bytes(*count);
    let needed = 8 + 24 * u128::from(count);
    if needed != bytes.len() as u128 {
        return Err(PointsFault::Length { count, needed, found: bytes.len() });
    }
    let points: Vec<Point> = numbers(rest).as_chunks::<3>().0.iter().map(|&c| Point::from(c)).collect();
    match points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        Some(index) => Err(PointsFault::NotFinite { index }),
        None => Ok(points),
    }
}

/// Refuses an output file that cannot be written, before the work starts; an existing file stays unchanged.
pub(super) fn refuse_unwritable(path: &Path) -> Result<(), BenchError> {
    let there = path.exists();
    let opened = fs::OpenOptions::new().append(true).create(true).open(path);
    opened.map_err(|source| BenchError::File { what: "write", path: path.to_owned(), source })?;
    if !there {
        // An empty file would be mistaken for a result.
        fs::remove_file(path).ok();
    }
    Ok(())
}

/// A temporary directory that is removed on drop.
pub(super) struct Scratch(PathBuf);

impl Scratch {
    pub(super) fn new() -> Result<Self, BenchError> {
        let path = std::env::temp_dir().join(format!("prosopon-bench-{}", std::process::id()));
        fs::create_dir_all(&path).map_err(|source| BenchError::File { what: "make", path: path.clone(), source })?;
        Ok(Self(path))
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_that_cannot_be_written_is_refused_and_others_stay_as_they_are() {
        let scratch = tempfile::tempdir().unwrap();
        let (there, new) = (scratch.path().join("there.csv"), scratch.path().join("new.csv"));
        fs::write(&there, "before").unwrap();
        refuse_unwritable(&there).unwrap();
        refuse_unwritable(&new).unwrap();
        assert!(fs::read(&there).unwrap() == b"before" && !new.exists());
        for place in [scratch.path().to_owned(), scratch.path().join("no/such/folder.csv")] {
            assert!(matches!(refuse_unwritable(&place), Err(BenchError::File { what: "write", .. })));
        }
    }

    #[test]
    fn files_that_are_no_points_are_refused() {
        let file = |count: u64, numbers: &[f64]| {
            let mut bytes = count.to_le_bytes().to_vec();
            bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
            points(&bytes)
        };
        assert_eq!(points(&[]), Err(PointsFault::NoCount { found: 0 }));
        assert_eq!(points(&[1, 0, 0]), Err(PointsFault::NoCount { found: 3 }));
        assert_eq!(file(0, &[]), Ok(vec![]));
        assert_eq!(file(1, &[1.0, 2.0, 3.0]), Ok(vec![Point::new(1.0, 2.0, 3.0)]));
        assert_eq!(file(2, &[1.0, 2.0, 3.0]), Err(PointsFault::Length { count: 2, needed: 56, found: 32 }));
        assert!(matches!(file(u64::MAX, &[1.0]), Err(PointsFault::Length { .. })));
        assert_eq!(file(2, &[0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0]), Err(PointsFault::NotFinite { index: 1 }));
        assert_eq!(file(1, &[f64::INFINITY, 0.0, 0.0]), Err(PointsFault::NotFinite { index: 0 }));
    }
}
