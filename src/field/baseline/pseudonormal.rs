use crate::defects::weld;
use prosopon_geometry::{Point, TriMesh, Vector};
use rayon::prelude::*;

/// Sides of a surface by the angle-weighted pseudonormal of the closest feature.
///
/// Vertices at the same position count as one. The normal of a vertex is Σ nᵢθᵢ (Wang 2009, eq. 0.4), that of an edge the sum of
/// the unit normals of all its triangles (eq. 0.5), that of a face its own.
///
/// # Accuracy
/// Right for closed, two-manifold surfaces without self-intersections; the side can be wrong on others.
///
/// # Source
/// J. A. Bærentzen, H. Aanæs, Signed distance computation using the angle weighted pseudonormal, IEEE TVCG 2005.
#[derive(Debug)]
pub(super) struct Pseudonormals {
    faces: Vec<Vector>,
    /// Normals of the edges from corner 0 to 1, 1 to 2 and 2 to 0 of each triangle; not normalised.
    edges: Vec<[Vector; 3]>,
    vertices: Vec<Vector>,
    triangles: Vec<[u32; 3]>,
    /// Squared sine of the largest angle between each triangle's normal and its pseudonormals.
    ///
    /// These are the pseudonormals of its edges and vertices. At least 1 when an angle exceeds a right angle.
    spread: Vec<f32>,
}

impl Pseudonormals {
    pub(super) fn new(mesh: &TriMesh) -> Self {
        let welded = weld(mesh.positions());
        let triangles: Vec<[u32; 3]> = mesh.triangles().iter().map(|t| t.map(|v| welded[v as usize])).collect();
        let faces: Vec<Vector> = (0..triangles.len())
            .into_par_iter()
            .map(|t| mesh.scaled_normal(t).try_normalize(0.0).unwrap_or_else(Vector::zeros))
            .collect();
        let vertices = vertex_sums(mesh, &triangles, &faces);
        let edges = edge_sums(&triangles, &faces, mesh.positions().len());
        let spread = (0..triangles.len())
            .into_par_iter()
            .map(|t| {
                let around = edges[t].iter().chain(triangles[t].iter().map(|&v| &vertices[v as usize]));
                around.map(|normal| spread(&faces[t], normal)).fold(0.0, f32::max)
            })
            .collect();
        Self { faces, edges, vertices, triangles, spread }
    }

    /// Whether a point is certainly on the side that its `height` above triangle `t` indicates.
    ///
    /// It is, whatever the closest feature is, when the angle between the direction from the closest point and the normal is
    /// smaller than a right angle minus the largest angle between the normal and a pseudonormal.
    pub(super) fn is_clear(&self, t: u32, height: f32, distance_sq: f32) -> bool {
        height * height > self.spread[t as usize] * distance_sq
    }

    /// Distance from `p` to triangle `t` of `corners`, negative behind the closest feature, mm.
    pub(super) fn signed(&self, p: &Point, corners: &[Point; 3], t: usize) -> f64 {
        let (offset, feature) = closest_feature(p, corners, &self.faces[t]);
        let normal = match feature {
            Feature::Face => &self.faces[t],
            Feature::Edge(i) => &self.edges[t][i],
            Feature::Vertex(i) => &self.vertices[self.triangles[t][i] as usize],
        };
        let distance = offset.norm();
        if normal.dot(&offset) < 0.0 { -distance } else { distance }
    }
}

/// The feature of a triangle that is closest to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Feature {
    Face,
    /// The edge from this corner to the next.
    Edge(usize),
    Vertex(usize),
}

/// Vector from the closest point of a triangle to `p`, and the feature that holds the closest point.
///
/// A triangle whose unit normal is zero counts as its edges.
fn closest_feature(p: &Point, corners: &[Point; 3], unit_normal: &Vector) -> (Vector, Feature) {
    let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
    let from = corners.map(|c| p - c);
    if *unit_normal != Vector::zeros() && (0..3).all(|i| unit_normal.cross(&edges[i]).dot(&from[i]) > 0.0) {
        return (unit_normal * unit_normal.dot(&from[0]), Feature::Face);
    }
    let mut best = (from[0], Feature::Vertex(0));
    let mut best_sq = f64::INFINITY;
    for i in 0..3 {
        let length_sq = edges[i].norm_squared();
        let along = edges[i].dot(&from[i]);
        let (offset, feature) = if along <= 0.0 {
            (from[i], Feature::Vertex(i))
        } else if along >= length_sq {
            (from[(i + 1) % 3], Feature::Vertex((i + 1) % 3))
        } else {
            (from[i] - edges[i] * (along / length_sq), Feature::Edge(i))
        };
        let distance_sq = offset.norm_squared();
        if distance_sq < best_sq {
            best_sq = distance_sq;
            best = (offset, feature);
        }
    }
    best
}

fn spread(face: &Vector, normal: &Vector) -> f32 {
    let (sine_sq, cosine) = (face.cross(normal).norm_squared(), face.dot(normal));
    // The addition allows for rounding.
    if cosine > 0.0 { (sine_sq / normal.norm_squared()) as f32 + 1e-4 } else { 1.0 }
}

fn vertex_sums(mesh: &TriMesh, triangles: &[[u32; 3]], faces: &[Vector]) -> Vec<Vector> {
    let angles: Vec<[f64; 3]> = (0..triangles.len())
        .into_par_iter()
        .map(|t| {
            let c = mesh.corners(t);
            [0, 1, 2].map(|i| {
                let (u, v) = (c[(i + 1) % 3] - c[i], c[(i + 2) % 3] - c[i]);
                u.cross(&v).norm().atan2(u.dot(&v))
            })
        })
        .collect();
    let mut sums = vec![Vector::zeros(); mesh.positions().len()];
    for ((corners, normal), angles) in triangles.iter().zip(faces).zip(&angles) {
        for (&v, angle) in corners.iter().zip(angles) {
            sums[v as usize] += normal * *angle;
        }
    }
    sums
}

fn edge_sums(triangles: &[[u32; 3]], faces: &[Vector], n_vertices: usize) -> Vec<[Vector; 3]> {
    // Lists the sides by their smaller vertex, as pairs of the larger vertex and the side.
    let ends = |side: usize| {
        let t = &triangles[side / 3];
        let (a, b) = (t[side % 3], t[(side + 1) % 3]);
        (a.min(b), a.max(b))
    };
    let mut first = vec![0u32; n_vertices + 1];
    for side in 0..3 * triangles.len() {
        first[ends(side).0 as usize + 1] += 1;
    }
    for v in 0..n_vertices {
        first[v + 1] += first[v];
    }
    let mut next = first.clone();
    let mut sides = vec![(0u32, 0u32); 3 * triangles.len()];
    for side in 0..3 * triangles.len() {
        let (low, high) = ends(side);
        sides[next[low as usize] as usize] = (high, side as u32);
        next[low as usize] += 1;
    }
    let mut edges = vec![[Vector::zeros(); 3]; triangles.len()];
    for v in 0..n_vertices {
        let around = &mut sides[first[v] as usize..first[v + 1] as usize];
        around.sort_unstable();
        for same in around.chunk_by(|a, b| a.0 == b.0) {
            let sum: Vector = same.iter().map(|s| faces[s.1 as usize / 3]).sum();
            for side in same {
                edges[side.1 as usize / 3][side.1 as usize % 3] = sum;
            }
        }
    }
    edges
}
