use super::{Motion, Point, Vector};

/// Reason why vertices and triangles do not make a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are only {n_vertices} vertices")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index that is out of range.
        vertex: u32,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// There are no triangles.
    #[error("the surface has no triangles")]
    Empty,
}

/// Axis-aligned box, LPS mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Smallest coordinates.
    pub min: Point,
    /// Largest coordinates.
    pub max: Point,
}

impl Aabb {
    /// The smallest box around `points`; `None` when there are none.
    pub fn of<'a>(points: impl IntoIterator<Item = &'a Point>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = *points.next()?;
        Some(points.fold(Self { min: first, max: first }, |b, p| Self { min: b.min.inf(p), max: b.max.sup(p) }))
    }

    /// The box grown by `margin` (mm) on every side.
    #[must_use]
    pub fn grown(&self, margin: f64) -> Self {
        let m = Vector::repeat(margin);
        Self { min: self.min - m, max: self.max + m }
    }

    /// Whether `p` lies in the closed box.
    #[must_use]
    pub fn contains(&self, p: &Point) -> bool {
        (0..3).all(|a| self.min[a] <= p[a] && p[a] <= self.max[a])
    }

    /// The smallest box along the axes around the moved box.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        let (centre, half) = (motion * self.center(), (self.max - self.min) / 2.0);
        let reach = motion.rotation.to_rotation_matrix().matrix().abs() * half;
        Self { min: centre - reach, max: centre + reach }
    }

    /// Centre of the box.
    #[must_use]
    pub fn center(&self) -> Point {
        nalgebra::center(&self.min, &self.max)
    }

    /// Length of the box's diagonal, mm.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.max - self.min).norm()
    }
}

/// An indexed triangle mesh in LPS mm; counter-clockwise seen from outside when it bounds a solid.
///
/// Coordinates are finite, indices are in range and there is at least one triangle. The mesh may be open, non-manifold or
/// self-intersecting: [`surface_report`](crate::surface_report) measures that.
///
/// ```
/// use prosopon_geometry::{Point, TriMesh};
///
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let positions = corners.map(Point::from).to_vec();
/// let tetrahedron = TriMesh::new(positions, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
/// assert!((tetrahedron.volume() - 1.0 / 6.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// Makes a mesh of vertices (LPS mm) and triangles (vertex indices) after checking both.
    ///
    /// # Errors
    /// [`GeometryError`] for a coordinate that is not finite, an index out of range, or no triangles.
    pub fn new(positions: Vec<Point>, triangles: Vec<[u32; 3]>) -> Result<Self, GeometryError> {
        if triangles.is_empty() {
            return Err(GeometryError::Empty);
        }
        if let Some(vertex) = positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(GeometryError::NotFinite { vertex });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= positions.len()) {
                return Err(GeometryError::IndexOutOfRange { triangle, vertex, n_vertices: positions.len() });
            }
        }
        Ok(Self { positions, triangles })
    }

    /// The vertex positions, LPS mm, and the vertex indices of each triangle.
    #[must_use]
    pub fn into_parts(self) -> (Vec<Point>, Vec<[u32; 3]>) {
        (self.positions, self.triangles)
    }

    /// Vertex positions, LPS mm.
    #[must_use]
    pub fn positions(&self) -> &[Point] {
        &self.positions
    }

    /// Vertex indices of each triangle.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The three corners of triangle `index`.
    #[must_use]
    pub fn corners(&self, index: usize) -> [Point; 3] {
        self.triangles[index].map(|v| self.positions[v as usize])
    }

    /// Outward normal of triangle `index` times twice its area, mm².
    #[must_use]
    pub fn scaled_normal(&self, index: usize) -> Vector {
        scaled_normal(&self.corners(index))
    }

    /// Unit normals of the vertices; zero where undefined.
    ///
    /// Triangle normals are weighted by their angle at the vertex (Wang 2009, eq. 0.3).
    #[must_use]
    pub fn vertex_normals(&self) -> Vec<Vector> {
        let mut normals = vec![Vector::zeros(); self.positions.len()];
        for (index, corners) in self.triangles.iter().enumerate() {
            let Some(normal) = self.scaled_normal(index).try_normalize(0.0) else { continue };
            let points = self.corners(index);
            for i in 0..3 {
                let u = points[(i + 1) % 3] - points[i];
                let v = points[(i + 2) % 3] - points[i];
                normals[corners[i] as usize] += normal * u.angle(&v);
            }
        }
        for n in &mut normals {
            *n = n.try_normalize(1e-12).unwrap_or_else(Vector::zeros);
        }
        normals
    }

    /// Box around all vertices.
    #[must_use]
    pub fn bounds(&self) -> Aabb {
        Aabb::of(&self.positions).unwrap_or(Aabb { min: Point::origin(), max: Point::origin() })
    }

    /// Total area, mm².
    #[must_use]
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| 0.5 * self.scaled_normal(t).norm()).sum()
    }

    /// Enclosed signed volume, mm³; meaningful only for a closed surface.
    ///
    /// Positive when triangles are counter-clockwise seen from outside.
    #[must_use]
    pub fn volume(&self) -> f64 {
        // Relative to the box's centre: far from the origin, large terms would cancel and lose digits.
        let o = self.bounds().center();
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                (a - o).dot(&(b - o).cross(&(c - o))) / 6.0
            })
            .sum()
    }

    /// The same triangles with every vertex moved by `target_from_source`.
    #[must_use]
    pub fn moved(&self, target_from_source: &Motion) -> Self {
        Self {
            positions: self.positions.iter().map(|p| target_from_source * p).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// The same triangles with other vertex positions, LPS mm.
    ///
    /// # Errors
    /// [`GeometryError`] when a position is not finite or a triangle refers to a vertex beyond the last position.
    pub fn with_positions(&self, positions: Vec<Point>) -> Result<Self, GeometryError> {
        Self::new(positions, self.triangles.clone())
    }
}

/// Normal of a triangle times twice its area, mm².
pub(super) fn scaled_normal([a, b, c]: &[Point; 3]) -> Vector {
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> TriMesh {
        let p = vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0), Point::new(0.0, 0.0, 1.0)];
        TriMesh::new(p, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()
    }

    #[test]
    fn volume_and_area_of_the_unit_tetrahedron() {
        let mesh = tetrahedron();
        assert!((mesh.volume() - 1.0 / 6.0).abs() < 1e-14);
        assert!((mesh.area() - (1.5 + 0.75f64.sqrt())).abs() < 1e-14);
    }

    #[test]
    fn faulty_input_is_refused_with_its_place() {
        let p = vec![Point::origin(), Point::new(f64::NAN, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)];
        assert_eq!(TriMesh::new(p.clone(), vec![[0, 1, 2]]), Err(GeometryError::NotFinite { vertex: 1 }));
        let good = vec![p[0], p[2]];
        assert_eq!(
            TriMesh::new(good.clone(), vec![[0, 1, 2]]),
            Err(GeometryError::IndexOutOfRange { triangle: 0, vertex: 2, n_vertices: 2 })
        );
        assert_eq!(TriMesh::new(good, vec![]), Err(GeometryError::Empty));
    }
}
