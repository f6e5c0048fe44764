//! Triangles at each edge, and disjoint sets for connected parts.

use super::TriMesh;

/// One side of one triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The side's two vertices, the smaller index first.
    pub(super) edge: [u32; 2],
    /// Index of the triangle.
    pub(super) triangle: u32,
    /// Whether the triangle traverses the side from the smaller index to the larger.
    pub(super) forward: bool,
}

/// The sides of all triangles, ordered by edge and then by triangle.
///
/// A triangle with a repeated vertex has a side from that vertex to itself. `chunk_by(|a, b| a.edge == b.edge)` groups the
/// sides by edge.
pub(super) fn sides(mesh: &TriMesh) -> Vec<Side> {
    let mut sides = Vec::with_capacity(3 * mesh.triangles().len());
    for (triangle, &[a, b, c]) in mesh.triangles().iter().enumerate() {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let edge = [from.min(to), from.max(to)];
            sides.push(Side { edge, triangle: triangle as u32, forward: from < to });
        }
    }
    sides.sort_unstable();
    sides
}

/// Disjoint sets (union-find) of the numbers `0..n`.
#[derive(Debug)]
pub(super) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// `n` sets of one number each.
    pub(super) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    /// The smallest number in the set that holds `i`.
    pub(super) fn find(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let above = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = above;
            i = above;
        }
        i
    }

    /// Merges the sets that hold `i` and `j`.
    pub(super) fn join(&mut self, i: u32, j: u32) {
        let (i, j) = (self.find(i), self.find(j));
        self.parent[i.max(j) as usize] = i.min(j);
    }

    /// Number of sets that hold at least one of `members`.
    pub(super) fn count(&mut self, members: impl IntoIterator<Item = u32>) -> usize {
        let mut roots: Vec<u32> = members.into_iter().map(|i| self.find(i)).collect();
        roots.sort_unstable();
        roots.dedup();
        roots.len()
    }
}
