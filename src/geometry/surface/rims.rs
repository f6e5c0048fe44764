//! Joins vertices at open edges that lie next to each other.

use crate::connectivity::{Edges, Sets};
use crate::{Aabb, Point, Vector};

/// Distance within which vertices at open edges are one, as a share of the surface's diagonal.
///
/// Text with six digits, as VTK writes it, has steps of 0.001 mm for a head, so two copies of a point differ by up to 0.0018 mm;
/// the share is 0.003 mm for a diagonal of 300 mm. Rounding to `f32` is a hundred times smaller. Edges of scans and CT surfaces
/// are a hundred times longer.
const NEAR_SHARE: f64 = 1e-5;

/// Most pairs of vertices that are compared, per vertex, before the search gives up.
const MAX_PAIRS: usize = 100;

/// What was joined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JoinedRims {
    /// Vertices that became another one.
    pub(super) vertices: usize,
    /// Distance within which they were joined, mm.
    pub(super) tolerance_mm: f64,
}

/// Joins vertices at edges with one triangle that lie within a tolerance of each other; `None` when there are none.
///
/// Only such vertices are compared, so that fine details of a closed surface stay. A group of vertices stays as it is when it
/// extends over more than twice the tolerance, or when it holds two corners of one triangle. The position of a group is the
/// first of its positions in the order of x, y and z, whatever the order of vertices.
pub(super) fn join_rims(positions: &mut [Point], triangles: &mut [[u32; 3]], edges: &Edges) -> Option<JoinedRims> {
    let mut rim: Vec<u32> = edges.iter().filter(|(_, sides)| sides.len() == 1).flat_map(|(edge, _)| edge).collect();
    rim.sort_unstable();
    rim.dedup();
    let tolerance = NEAR_SHARE * Aabb::of(&*positions)?.diagonal();
    if rim.is_empty() || tolerance <= 0.0 {
        return None;
    }
    let mut groups = Sets::new(positions.len());
    let pairs = near_pairs(positions, &rim, tolerance)?;
    if pairs.is_empty() {
        return None;
    }
    for [a, b] in pairs {
        groups.join(a, b);
    }
    let mut members: Vec<[u32; 2]> = rim.iter().map(|&v| [groups.find(v), v]).collect();
    members.sort_unstable();
    let mut split = vec![false; positions.len()];
    for t in triangles.iter() {
        let roots = t.map(|v| groups.find(v));
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            split[roots[i] as usize] |= roots[i] == roots[j] && t[i] != t[j];
        }
    }
    let mut target: Vec<u32> = (0..positions.len() as u32).collect();
    let mut joined = 0;
    for group in members.chunk_by(|a, b| a[0] == b[0]).filter(|g| g.len() > 1) {
        let root = group[0][0];
        let places = || group.iter().map(|m| &positions[m[1] as usize]);
        let size = Aabb::of(places()).map_or(0.0, |b| b.diagonal());
        if split[root as usize] || size > 2.0 * tolerance {
            continue;
        }
        let first = places().min_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z)));
        let Some(first) = first.copied() else { continue };
        for member in group {
            target[member[1] as usize] = root;
        }
        positions[root as usize] = first;
        joined += group.len() - 1;
    }
    for v in triangles.iter_mut().flatten() {
        *v = target[*v as usize];
    }
    (joined > 0).then_some(JoinedRims { vertices: joined, tolerance_mm: tolerance })
}

/// Pairs of the vertices `rim` within `tolerance` of each other; `None` when too many lie close together.
fn near_pairs(positions: &[Point], rim: &[u32], tolerance: f64) -> Option<Vec<[u32; 2]>> {
    // Cells much larger than the tolerance: most vertices are compared with those of their own cell only.
    let cell = 8.0 * tolerance;
    let cell_of = |p: Point| [0, 1, 2].map(|a| (p[a] / cell).floor() as i64);
    let mut cells: Vec<([i64; 3], u32)> = rim.iter().map(|&v| (cell_of(positions[v as usize]), v)).collect();
    cells.sort_unstable();
    let mut budget = rim.len().saturating_mul(MAX_PAIRS);
    let mut pairs = Vec::new();
    for &(_, v) in &cells {
        let p = positions[v as usize];
        let (low, high) = (cell_of(p - Vector::repeat(tolerance)), cell_of(p + Vector::repeat(tolerance)));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                let from = cells.partition_point(|(c, _)| *c < [x, y, low[2]]);
                for (_, other) in cells[from..].iter().take_while(|(c, _)| *c <= [x, y, high[2]]) {
                    budget = budget.checked_sub(1)?;
                    if *other > v && (positions[*other as usize] - p).norm() <= tolerance {
                        pairs.push([v, *other]);
                    }
                }
            }
        }
    }
    Some(pairs)
}
