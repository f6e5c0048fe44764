//! Triangles at each edge, and disjoint sets for connected parts.

/// One side of one triangle, in the list of its edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The edge's vertex with the larger index.
    end: u32,
    /// Twice the index of the triangle, plus one if the side runs forward.
    triangle_and_way: u32,
}

impl Side {
    /// Index of the triangle.
    pub(super) fn triangle(self) -> u32 {
        self.triangle_and_way >> 1
    }

    /// Whether the triangle traverses the side from the smaller index to the larger.
    pub(super) fn forward(self) -> bool {
        self.triangle_and_way & 1 == 1
    }
}

/// The sides of all triangles, grouped by edge.
///
/// Takes 24 bytes per triangle and time in proportion, since the sides are sorted by their smaller vertex by counting.
#[derive(Debug)]
pub(super) struct Edges {
    /// Where the sides of each vertex with the smaller index begin; one more than there are vertices.
    starts: Vec<u32>,
    /// Sides by smaller vertex, then larger vertex, triangle and direction.
    sides: Vec<Side>,
}

impl Edges {
    /// The edges of triangles whose indices are below `n_vertices`.
    ///
    /// A triangle with a repeated vertex has an edge from that vertex to itself.
    pub(super) fn of(n_vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut starts = vec![0u32; n_vertices + 1];
        for &[a, b, c] in triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                starts[from.min(to) as usize] += 1;
            }
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        // Filled from the back, so that each start ends where its list begins.
        let mut sides = vec![Side { end: 0, triangle_and_way: 0 }; 3 * triangles.len()];
        for (triangle, &[a, b, c]) in triangles.iter().enumerate().rev() {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let start = &mut starts[from.min(to) as usize];
                *start -= 1;
                let triangle_and_way = 2 * triangle as u32 + u32::from(from < to);
                sides[*start as usize] = Side { end: from.max(to), triangle_and_way };
            }
        }
        for of_vertex in starts.windows(2) {
            sides[of_vertex[0] as usize..of_vertex[1] as usize].sort_unstable();
        }
        Self { starts, sides }
    }

    /// Each edge, the smaller index first, with its sides by triangle; edges rise.
    pub(super) fn iter(&self) -> impl Iterator<Item = ([u32; 2], &[Side])> {
        self.starts.windows(2).enumerate().flat_map(|(vertex, range)| {
            let sides = &self.sides[range[0] as usize..range[1] as usize];
            sides.chunk_by(|a, b| a.end == b.end).map(move |same| ([vertex as u32, same[0].end], same))
        })
    }
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
