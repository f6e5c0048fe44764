use crate::fem::Solver;
use crate::geometry::{Aabb, TriMesh, Vector};
use crate::mesh::Embedding;

/// Most sweeps of the smoothing; holes are some ten vertices wide.
const MOST_SWEEPS: usize = 200;
/// Sweeps end when no vertex moves farther than this, mm.
const SETTLED_MM: f64 = 1e-4;

/// Carries the user's skin along with the prisms.
///
/// Vertices without a prism, under folds that could not be meshed and beyond the region, follow the mean of their
/// neighbours: far from the region, where the prisms' edge is fixed, that is no displacement.
pub(super) struct Carrier<'a> {
    embedding: &'a Embedding,
    /// Vertices without a prism, rising, with their neighbours.
    loose: Vec<(usize, Vec<u32>)>,
}

impl<'a> Carrier<'a> {
    pub(super) fn new(skin: &TriMesh, embedding: &'a Embedding) -> Self {
        let mut neighbours = vec![Vec::new(); skin.positions().len()];
        for t in skin.triangles() {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                for (from, to) in [(a, b), (b, a)] {
                    if embedding.anchors[from as usize].is_none() {
                        neighbours[from as usize].push(to);
                    }
                }
            }
        }
        let loose = neighbours.into_iter().enumerate().filter(|(_, n)| !n.is_empty()).map(|(vertex, mut near)| {
            near.sort_unstable();
            near.dedup();
            (vertex, near)
        });
        Self { embedding, loose: loose.collect() }
    }

    /// Says how many vertices inside `region` have no prism.
    pub(super) fn warning(&self, skin: &TriMesh, region: &Aabb) -> Option<String> {
        let inside = self.loose.iter().filter(|(v, _)| region.contains(&skin.positions()[*v])).count();
        (inside > 0).then(|| {
            format!("{inside} vertices of the skin in the region lie on no prism (folds, nostrils, the back): they follow their neighbours")
        })
    }

    /// Displacement of every vertex of the skin, mm.
    pub(super) fn displacements(&self, solver: &Solver<'_>) -> Vec<Vector> {
        let anchors = self.embedding.anchors.iter();
        let mut u: Vec<Vector> =
            anchors.map(|a| a.map_or_else(Vector::zeros, |(prism, l)| solver.outer_displacement(prism, l))).collect();
        for sweep in 0..MOST_SWEEPS {
            let mut largest = 0.0f64;
            for i in 0..self.loose.len() {
                let (vertex, near) = &self.loose[if sweep % 2 == 0 { i } else { self.loose.len() - 1 - i }];
                let mean = near.iter().map(|n| u[*n as usize]).sum::<Vector>() / near.len() as f64;
                largest = largest.max((mean - u[*vertex]).norm());
                u[*vertex] = mean;
            }
            if largest < SETTLED_MM {
                break;
            }
        }
        u
    }
}
