//! Signed distances to a surface that may be open.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::{TriMesh as Shape, TrianglePointLocation};
use rayon::prelude::*;

use super::EvaluateError;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, TriMesh, Vector};

/// Points handled between two checks for cancellation.
const CHUNK: usize = 2048;

/// A surface prepared for closest-point queries. Vertices with equal coordinates are merged.
pub(super) struct Surface {
    shape: Shape,
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
    faces: Vec<Vector>,
    vertices: Vec<Vector>,
    /// Vertex pairs in ascending order, each with the sum of its triangles' unit normals and their number.
    edges: Vec<((u32, u32), Vector, u32)>,
    /// Whether each vertex lies on an edge with a single triangle.
    on_border: Vec<bool>,
    /// Number of edges along which two triangles run in one direction.
    inconsistent: usize,
}

/// Closest point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) point: Point,
    pub(super) triangle: usize,
    /// Pseudonormal of the closest feature, unit length.
    pub(super) normal: Vector,
    /// Signed distance, mm; negative behind the surface.
    pub(super) signed: f64,
    /// Whether the closest feature lies on the open border; the distance then carries no information about the surface.
    pub(super) on_border: bool,
}

impl Surface {
    pub(super) fn new(mesh: &TriMesh) -> Result<Self, EvaluateError> {
        let Welded { positions, triangles, .. } = welded(mesh);
        let input = |detail: String| EvaluateError::Input { detail };
        let welded = TriMesh::new(positions, triangles).map_err(|e| input(e.to_string()))?;
        let faces: Vec<Vector> = (0..welded.triangles().len())
            .map(|t| welded.scaled_normal(t).try_normalize(0.0).unwrap_or_else(Vector::zeros))
            .collect();
        let mut inconsistent = 0;
        let mut sides: Vec<((u32, u32), u32)> = Vec::with_capacity(3 * welded.triangles().len());
        for (t, corners) in welded.triangles().iter().enumerate() {
            sides.extend((0..3).map(|i| (pair(corners[i], corners[(i + 1) % 3]), t as u32)));
        }
        sides.par_sort_unstable();
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            let ascending = |s: &&((u32, u32), u32)| runs_along(welded.triangles()[s.1 as usize], s.0);
            inconsistent += usize::from(same.len() == 2 && same.iter().filter(ascending).count() != 1);
        }
        let edges: Vec<((u32, u32), Vector, u32)> = sides
            .chunk_by(|a, b| a.0 == b.0)
            .map(|same| (same[0].0, same.iter().map(|s| faces[s.1 as usize]).sum(), same.len() as u32))
            .collect();
        let mut on_border = vec![false; welded.positions().len()];
        for ((a, b), ..) in edges.iter().filter(|e| e.2 == 1) {
            on_border[*a as usize] = true;
            on_border[*b as usize] = true;
        }
        let vertices = welded.vertex_normals();
        let points = welded.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
        let shape = Shape::new(points, welded.triangles().to_vec()).map_err(|e| input(format!("{e:?}")))?;
        let (positions, triangles) = (welded.positions().to_vec(), welded.triangles().to_vec());
        Ok(Self { shape, positions, triangles, faces, vertices, edges, on_border, inconsistent })
    }

    /// Closest point to `p`; the sign is that of the angle-weighted pseudonormal of the closest feature.
    ///
    /// # Source
    /// Bærentzen & Aanæs, Signed distance computation using the angle weighted pseudonormal, 2005.
    pub(super) fn nearest(&self, p: &Point) -> Nearest {
        let query = ParryVector::new(p.x, p.y, p.z);
        let (projection, (triangle, location)) = self.shape.project_local_point_and_get_location(query, false);
        let point = Point::new(projection.point.x, projection.point.y, projection.point.z);
        let corners = self.triangles[triangle as usize];
        let (normal, on_border) = match location {
            TrianglePointLocation::OnVertex(i) => {
                let v = corners[i as usize] as usize;
                (self.vertices[v], self.on_border[v])
            }
            // Parry numbers the edges AB, BC, AC.
            TrianglePointLocation::OnEdge(i, _) => {
                let (a, b) = [(0, 1), (1, 2), (0, 2)][i as usize];
                let found = self.edges.binary_search_by_key(&pair(corners[a], corners[b]), |e| e.0);
                found.map_or((Vector::zeros(), true), |i| (self.edges[i].1, self.edges[i].2 == 1))
            }
            TrianglePointLocation::OnFace(..) | TrianglePointLocation::OnSolid => {
                (self.faces[triangle as usize], false)
            }
        };
        // A point on the surface has the distance 0 exactly: the projection's rounding must not appear as a distance.
        let is_corner = corners.into_iter().any(|v| self.positions[v as usize] == *p);
        let point = if is_corner { *p } else { point };
        let away = p - point;
        let signed = if away.dot(&normal) < 0.0 { -away.norm() } else { away.norm() };
        let normal = normal.try_normalize(1e-12).unwrap_or_else(Vector::zeros);
        Nearest { point, triangle: triangle as usize, normal, signed, on_border }
    }

    /// Share of the edges along which two triangles run in one direction.
    ///
    /// Their normals face opposite ways, so that the sign of distances there means nothing.
    pub(super) fn inconsistent_share(&self) -> f64 {
        self.inconsistent as f64 / self.edges.len().max(1) as f64
    }

    /// Closest points of many points, in their order.
    pub(super) fn all_nearest(&self, points: &[Point], control: &Control) -> Result<Vec<Nearest>, Cancelled> {
        let chunks: Vec<Vec<Nearest>> = points
            .par_chunks(CHUNK)
            .map(|chunk| {
                control.check()?;
                Ok(chunk.iter().map(|p| self.nearest(p)).collect())
            })
            .collect::<Result<_, Cancelled>>()?;
        Ok(chunks.concat())
    }
}

/// Whether a triangle runs from `a` to `b`, two of its corners.
fn runs_along(triangle: [u32; 3], (a, b): (u32, u32)) -> bool {
    (0..3).any(|i| triangle[i] == a && triangle[(i + 1) % 3] == b)
}

fn pair(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

/// A mesh whose vertices with equal coordinates are merged.
pub(super) struct Welded {
    pub(super) positions: Vec<Point>,
    /// Triangles in the order of the original mesh.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Merged vertex of each vertex of the original mesh.
    pub(super) number: Vec<u32>,
}

pub(super) fn welded(mesh: &TriMesh) -> Welded {
    let all = mesh.positions();
    let compare =
        |a: &Point, b: &Point| a.x.total_cmp(&b.x).then_with(|| a.y.total_cmp(&b.y)).then_with(|| a.z.total_cmp(&b.z));
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.par_sort_unstable_by(|a, b| compare(&all[*a], &all[*b]).then(a.cmp(b)));
    let mut positions: Vec<Point> = Vec::new();
    let mut number = vec![0u32; all.len()];
    for i in order {
        if positions.last() != Some(&all[i]) {
            positions.push(all[i]);
        }
        number[i] = positions.len() as u32 - 1;
    }
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| number[v as usize])).collect();
    Welded { positions, triangles, number }
}
