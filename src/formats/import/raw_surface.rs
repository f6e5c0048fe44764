//! Vertices and faces as a reader of surfaces delivers them, and the checks that all these formats share.

use super::error::{at_most, check_size, malformed};
use super::polygon::{MAX_CORNERS, fan};
use super::{ImportError, Limits};
use prosopon_geometry::{GeometryError, Point, TriMesh, Warning};

/// Vertices, triangles and warnings of a reader, unchecked.
#[derive(Debug, Default)]
pub(super) struct RawSurface {
    pub(super) positions: Vec<Point>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) warnings: Vec<Warning>,
}

impl RawSurface {
    /// Checks ranges and the size, and drops triangles with a repeated vertex and unused vertices.
    pub(super) fn finish(mut self) -> Result<(TriMesh, Vec<Warning>), ImportError> {
        let n_vertices = self.positions.len();
        let mut used = vec![false; n_vertices];
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for &vertex in corners {
                match used.get_mut(vertex as usize) {
                    Some(mark) => *mark = true,
                    None => return Err(GeometryError::IndexOutOfRange { triangle, vertex, n_vertices }.into()),
                }
            }
        }
        // Unused vertices may have any coordinates: scanners write NaN for points that they did not see.
        let faulty = self.positions.iter().zip(&used).position(|(p, u)| *u && !p.iter().all(|c| c.is_finite()));
        if let Some(vertex) = faulty {
            return Err(GeometryError::NotFinite { vertex }.into());
        }

        let before = self.triangles.len();
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        let dropped = before.saturating_sub(self.triangles.len());
        if dropped > 0 {
            let found = format!("{dropped} triangles with a repeated vertex were left out");
            self.warnings.push(Warning::info("repeated-vertices", found));
        }
        self.drop_unused();

        let mesh = TriMesh::new(self.positions, self.triangles)?;
        check_size(mesh.bounds().diagonal(), &mut self.warnings)?;
        Ok((mesh, self.warnings))
    }

    /// Drops vertices that no triangle uses. The caller has checked the indices.
    #[expect(clippy::indexing_slicing, reason = "indices were checked by the caller")]
    fn drop_unused(&mut self) {
        const UNUSED: u32 = u32::MAX;
        let mut new_index = vec![UNUSED; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            new_index[v as usize] = 0;
        }
        let unused = new_index.iter().filter(|&&i| i == UNUSED).count();
        if unused == 0 {
            return;
        }
        let kept = new_index.iter_mut().filter(|i| **i != UNUSED);
        for (new, index) in (0u32..).zip(kept) {
            *index = new;
        }
        let mut indices = new_index.iter();
        self.positions.retain(|_| indices.next() != Some(&UNUSED));
        for v in self.triangles.iter_mut().flatten() {
            *v = new_index[*v as usize];
        }
        let found = format!("{unused} vertices that no triangle uses were left out");
        self.warnings.push(Warning::info("unused-vertices", found));
    }
}

/// Collects faces with any number of corners as triangles.
#[derive(Debug)]
pub(super) struct Faces {
    format: &'static str,
    max_triangles: usize,
    triangles: Vec<[u32; 3]>,
    n_faces: u64,
    n_polygons: u64,
    n_lines: u64,
}

impl Faces {
    pub(super) fn new(format: &'static str, limits: &Limits) -> Self {
        let max_triangles = limits.max_triangles;
        Self { format, max_triangles, triangles: Vec::new(), n_faces: 0, n_polygons: 0, n_lines: 0 }
    }

    /// Adds the face with these corners; `positions` serve to split a polygon.
    pub(super) fn push(&mut self, positions: &[Point], corners: &[u32]) -> Result<(), ImportError> {
        let face = self.n_faces;
        self.n_faces = face.saturating_add(1);
        match *corners {
            [] | [_] | [_, _] => self.n_lines = self.n_lines.saturating_add(1),
            [a, b, c] => self.triangles.push([a, b, c]),
            _ if corners.len() > MAX_CORNERS => {
                let detail = format!("face {face} has {} corners, at most {MAX_CORNERS} are read", corners.len());
                return Err(malformed(self.format, detail));
            }
            _ => {
                let n_vertices = positions.len();
                if let Some(v) = corners.iter().find(|&&v| v as usize >= n_vertices) {
                    let detail = format!("face {face} names vertex {v}, but there are only {n_vertices} before it");
                    return Err(malformed(self.format, detail));
                }
                let Some(triangles) = fan(positions, corners) else {
                    let n = corners.len();
                    let detail = format!("face {face} is a polygon of {n} corners that is not convex: triangulate it");
                    return Err(malformed(self.format, detail));
                };
                self.triangles.extend(triangles);
                self.n_polygons = self.n_polygons.saturating_add(1);
            }
        }
        at_most("triangles", self.triangles.len() as u64, self.max_triangles)
    }

    /// Ends the list and adds warnings about polygons and faces without area.
    pub(super) fn finish(self, positions: Vec<Point>) -> RawSurface {
        let mut warnings = Vec::new();
        if self.n_polygons > 0 {
            let found = format!("{} faces with more than three corners were split into triangles", self.n_polygons);
            warnings.push(Warning::info("split-polygons", found));
        }
        if self.n_lines > 0 {
            let found = format!("{} faces with fewer than three corners were left out", self.n_lines);
            warnings.push(Warning::info("faces-left-out", found));
        }
        RawSurface { positions, triangles: self.triangles, warnings }
    }
}
