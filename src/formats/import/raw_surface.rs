//! Vertices and faces as a reader of surfaces delivers them, and the checks that all these formats share.

use super::error::{at_most, check_size, malformed};
use super::polygon::{MAX_CORNERS, fan};
use super::stated::Stated;
use super::{ImportError, Limits};
use prosopon_geometry::{Aabb, GeometryError, Mending, Point, TriMesh, Warning, Welder, mend};

/// Vertices, triangles and warnings of a reader, unchecked.
#[derive(Debug, Default)]
pub(super) struct RawSurface {
    pub(super) positions: Vec<Point>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) warnings: Vec<Warning>,
    /// What the file states about its coordinates.
    pub(super) stated: Stated,
    /// Whether no two vertices have the same position, as the reader has merged them.
    pub(super) is_welded: bool,
}

impl RawSurface {
    /// Checks ranges and the size, converts what the file states to LPS and mm, and drops what only its form adds.
    ///
    /// Equal positions become one vertex. Triangles with a repeated vertex and unused vertices are dropped; then
    /// [`mend`](fn@mend) drops triangles that are stored twice, joins open edges and turns triangles outwards.
    pub(super) fn finish(mut self) -> Result<(TriMesh, Vec<Warning>), ImportError> {
        self.check()?;
        self.stated.apply(&mut self.positions, &mut self.triangles, &mut self.warnings);
        let merged = self.weld();
        let before = self.triangles.len();
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        let dropped = before.saturating_sub(self.triangles.len());
        if dropped > 0 {
            let found = format!("{dropped} triangles with a repeated vertex were left out");
            self.warnings.push(Warning::info("repeated-vertices", found));
        }
        let unused = self.drop_unused().saturating_sub(merged);
        if unused > 0 {
            let found = format!("{unused} vertices that no triangle uses were left out");
            self.warnings.push(Warning::info("unused-vertices", found));
        }
        let diagonal = Aabb::of(&self.positions).map(|b| b.diagonal()).ok_or(GeometryError::Empty)?;
        check_size(diagonal, &mut self.warnings)?;
        let (mesh, mending) = mend(self.positions, self.triangles)?;
        self.warnings.extend(mending_warnings(&mending));
        if mending.joined_vertices == 0 {
            return Ok((mesh, self.warnings));
        }
        let (positions, triangles) = mesh.into_parts();
        let mut joined = Self { positions, triangles, ..Self::default() };
        joined.drop_unused();
        Ok((TriMesh::new(joined.positions, joined.triangles)?, self.warnings))
    }

    /// Refuses indices out of range, and coordinates of used vertices that are not finite.
    fn check(&self) -> Result<(), ImportError> {
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
        Ok(())
    }

    /// Makes vertices at the same position one, the first of them, unless the reader has done so. Returns how many used vertices
    /// became another one; no triangle uses them any more.
    #[expect(clippy::indexing_slicing, reason = "indices were checked")]
    fn weld(&mut self) -> usize {
        if self.is_welded {
            return 0;
        }
        let first = first_at_each_position(&self.positions);
        let mut merged = vec![false; self.positions.len()];
        for v in self.triangles.iter_mut().flatten() {
            let target = first[*v as usize];
            merged[*v as usize] = target != *v;
            *v = target;
        }
        let n_merged = merged.iter().filter(|m| **m).count();
        if n_merged > 0 {
            let n = self.positions.len();
            let found = format!("{n_merged} of {n} vertices lie where an earlier one lies and were merged with it");
            self.warnings.push(Warning::info("split-vertices", found));
        }
        n_merged
    }

    /// Drops vertices that no triangle uses and returns their number. The caller has checked the indices.
    #[expect(clippy::indexing_slicing, reason = "indices were checked by the caller")]
    fn drop_unused(&mut self) -> usize {
        const UNUSED: u32 = u32::MAX;
        let mut new_index = vec![UNUSED; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            new_index[v as usize] = 0;
        }
        let unused = new_index.iter().filter(|&&i| i == UNUSED).count();
        if unused == 0 {
            return 0;
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
        unused
    }
}

/// For each vertex the first one at its position.
fn first_at_each_position(positions: &[Point]) -> Vec<u32> {
    let mut welder = Welder::with_capacity(positions.len());
    let mut first: Vec<u32> = Vec::with_capacity(positions.len());
    let mut of_number: Vec<u32> = Vec::with_capacity(positions.len());
    for (vertex, p) in (0u32..).zip(positions) {
        // NaN is equal to nothing; such vertices are not used.
        let number = if p.iter().all(|c| c.is_finite()) { welder.number(*p) as usize } else { usize::MAX };
        let earlier = of_number.get(number).copied();
        if earlier.is_none() && number != usize::MAX {
            of_number.push(vertex);
        }
        first.push(earlier.unwrap_or(vertex));
    }
    first
}

/// A warning for each kind of change.
fn mending_warnings(mending: &Mending) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut note = |n: usize, code: &'static str, found: &str| {
        if n > 0 {
            warnings.push(Warning::info(code, format!("{n} {found}")));
        }
    };
    note(
        mending.repeated_triangles,
        "repeated-triangles",
        "triangles have the same corners as an earlier one and were left out",
    );
    note(
        mending.second_sides,
        "second-sides",
        "triangles are the other side of a triangle with the same corners and were left out",
    );
    let joined = format!(
        "vertices at open edges lie within {:.4} mm of another one and were joined with it",
        mending.tolerance_mm
    );
    note(mending.joined_vertices, "joined-edges", &joined);
    note(
        mending.turned_triangles,
        "turned-triangles",
        "triangles faced inwards or against their neighbours and were turned",
    );
    if mending.opposed_triangles > 0 {
        let found = format!("{} triangles lie in pairs that face opposite ways", mending.opposed_triangles);
        warnings.push(Warning::check("opposed-triangles", found).act("Remove sheets without thickness."));
    }
    if mending.one_sided_parts > 0 {
        let found =
            format!("{} parts of the surface have no inside and outside, like a Möbius band", mending.one_sided_parts);
        warnings.push(Warning::check("one-sided-parts", found).act("Repair the surface there."));
    }
    warnings
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
        RawSurface { positions, triangles: self.triangles, warnings, ..RawSurface::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]];
    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    fn raw(positions: impl IntoIterator<Item = [f64; 3]>, triangles: Vec<[u32; 3]>) -> RawSurface {
        RawSurface { positions: positions.into_iter().map(Point::from).collect(), triangles, ..RawSurface::default() }
    }

    fn codes(warnings: &[Warning]) -> Vec<&str> {
        warnings.iter().map(|w| w.code).collect()
    }

    #[test]
    fn a_surface_with_a_vertex_for_each_corner_is_the_same_as_without() {
        let (expected, none) = raw(CORNERS, TETRAHEDRON.to_vec()).finish().unwrap();
        assert_eq!(none, []);
        let split = |shift: &dyn Fn(usize, f64) -> f64| {
            let corners = TETRAHEDRON.iter().flatten().enumerate();
            let positions = corners.map(|(n, v)| CORNERS[*v as usize].map(|x| shift(n, x)));
            let triangles = (0..4).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            raw(positions, triangles).finish().unwrap()
        };
        // -0 in every second corner.
        let (mesh, warnings) = split(&|n, x| if n % 2 == 0 && x == 0.0 { -0.0 } else { x });
        assert_eq!(codes(&warnings), ["split-vertices"]);
        assert!(warnings[0].message.starts_with("8 of 12 vertices"), "{}", warnings[0]);
        assert_eq!((mesh.positions().len(), mesh.volume()), (4, expected.volume()));
        // Rounded in different ways.
        let (mesh, warnings) = split(&|n, x| x + 1e-4 * n as f64);
        assert_eq!(codes(&warnings), ["joined-edges"]);
        assert!(warnings[0].message.starts_with("8 vertices at open edges lie within 0.0017 mm"), "{}", warnings[0]);
        assert_eq!(mesh.positions().len(), 4);
        // One vertex twice, and one that no triangle uses at the same place.
        let mut positions = CORNERS.to_vec();
        positions.extend([CORNERS[1], CORNERS[1], [f64::NAN; 3]]);
        let (mesh, warnings) = raw(positions, vec![[0, 2, 4], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).finish().unwrap();
        assert_eq!(codes(&warnings), ["split-vertices", "unused-vertices"]);
        assert!(warnings[0].message.starts_with("1 of 7") && warnings[1].message.starts_with("2 "), "{warnings:?}");
        assert_eq!(mesh, expected);
    }

    #[test]
    fn triangles_that_repeat_others_and_those_that_face_inwards_are_notes() {
        let mut triangles = TETRAHEDRON.to_vec();
        triangles.extend([[2, 1, 0], [1, 0, 3]]);
        triangles[2].reverse();
        let (mesh, warnings) = raw(CORNERS, triangles).finish().unwrap();
        assert_eq!(codes(&warnings), ["repeated-triangles", "second-sides", "turned-triangles"]);
        assert!(warnings.iter().all(|w| w.message.starts_with("1 ")), "{warnings:?}");
        assert!((mesh.volume() - 1e6 / 6.0).abs() < 1e-6 && mesh.triangles().len() == 4);
    }
}
