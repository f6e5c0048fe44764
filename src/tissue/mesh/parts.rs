//! Parts of the mesh that are connected through faces.

use super::adjacency::{Rows, groups, shared_faces, sorted};
use super::prisms::PrismLayer;
use super::stuffing::TetMesh;
use super::tuning::{MAX_DETACHED, MIN_PART_SHARE};

/// Parts that were dropped.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct LooseParts {
    pub(super) parts: usize,
    pub(super) elements: usize,
    /// Number of all elements before.
    pub(super) of: usize,
}

/// Keeps the large parts that carry prisms; returns what was dropped.
pub(super) fn keep_large_parts(mesh: &mut TetMesh, layer: &mut PrismLayer) -> LooseParts {
    let (n_tets, n_prisms) = (mesh.tetrahedra.len(), layer.faces.len());
    let pairs = joined(mesh, layer);
    let detached = detached(n_tets + n_prisms, n_tets, &pairs);
    let part = groups(
        n_tets + n_prisms,
        pairs.iter().copied().filter(|[a, b]| detached[*a as usize] == detached[*b as usize]),
    );
    let n_parts = part.iter().max().map_or(0, |p| *p as usize + 1);
    let mut sizes = vec![0usize; n_parts];
    let mut carries = vec![false; n_parts];
    for (element, &p) in part.iter().enumerate() {
        sizes[p as usize] += 1;
        carries[p as usize] |= element >= n_tets;
    }
    let largest = (0..n_parts).filter(|&p| carries[p]).map(|p| sizes[p]).max().unwrap_or(0);
    let keep = |element: usize| {
        let p = part[element] as usize;
        carries[p] && sizes[p] as f64 >= MIN_PART_SHARE * largest as f64
    };
    let mut index = 0;
    mesh.tetrahedra.retain(|_| {
        index += 1;
        keep(index - 1)
    });
    layer.faces.retain(|_| {
        index += 1;
        keep(index - 1)
    });
    let gone: Vec<usize> =
        (0..n_parts).filter(|&p| !carries[p] || (sizes[p] as f64) < MIN_PART_SHARE * largest as f64).collect();
    LooseParts { parts: gone.len(), elements: gone.iter().map(|&p| sizes[p]).sum(), of: n_tets + n_prisms }
}

/// Elements (tetrahedra, then prisms) that share a face.
fn joined(mesh: &TetMesh, layer: &PrismLayer) -> Vec<[u32; 2]> {
    let n_tets = mesh.tetrahedra.len();
    let (mut pairs, _) = shared_faces(&mesh.tetrahedra);
    // Prisms share their side faces (edges of the triangles) with prisms and their inner triangle with a tetrahedron.
    let mut edges: Vec<([u32; 2], u32)> = Vec::new();
    let mut triangles: Vec<([u32; 3], u32)> = Vec::new();
    for (f, face) in layer.faces.iter().enumerate() {
        let element = (n_tets + f) as u32;
        for i in 0..3 {
            edges.push((sorted([face[i], face[(i + 1) % 3]]), element));
        }
        triangles.push((sorted(*face), element));
    }
    edges.sort_unstable();
    triangles.sort_unstable();
    pairs.extend(edges.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| [w[0].1, w[1].1]));
    for face in super::adjacency::boundary(&mesh.tetrahedra) {
        if let Ok(at) = triangles.binary_search_by_key(&sorted(face.nodes), |t| t.0) {
            pairs.push([face.tetrahedron, triangles[at].1]);
        }
    }
    pairs
}

/// Marks tetrahedra in pieces of 2 to [`MAX_DETACHED`] that are attached by one face and carry no prism. Such pieces are soft and
/// fold under the first load. A single tetrahedron on a face is stiff.
fn detached(n: usize, n_tets: usize, pairs: &[[u32; 2]]) -> Vec<bool> {
    let neighbours = Rows::of(n, pairs.iter().flat_map(|&[a, b]| [(a, b), (b, a)]));
    // Bridges (Tarjan 1974): order of discovery, and the earliest element reached without the edge to the parent.
    let mut order = vec![u32::MAX; n];
    let mut lowest = vec![u32::MAX; n];
    let mut parent = vec![u32::MAX; n];
    let mut visited: Vec<u32> = Vec::with_capacity(n);
    // The search starts at the prisms, so that the detached side is the one without prisms.
    for root in (n_tets..n).chain(0..n_tets) {
        if order[root] != u32::MAX {
            continue;
        }
        let discover = |e: usize, visited: &mut Vec<u32>, order: &mut [u32], lowest: &mut [u32]| {
            order[e] = visited.len() as u32;
            lowest[e] = order[e];
            visited.push(e as u32);
        };
        discover(root, &mut visited, &mut order, &mut lowest);
        let mut stack = vec![(root, 0)];
        while let Some((e, at)) = stack.pop() {
            if let Some(&next) = neighbours.row(e).get(at) {
                stack.push((e, at + 1));
                let to = next as usize;
                if order[to] == u32::MAX {
                    parent[to] = e as u32;
                    discover(to, &mut visited, &mut order, &mut lowest);
                    stack.push((to, 0));
                } else if parent[e] != next {
                    lowest[e] = lowest[e].min(order[to]);
                }
            } else if parent[e] != u32::MAX {
                let above = parent[e] as usize;
                lowest[above] = lowest[above].min(lowest[e]);
            }
        }
    }
    let mut size = vec![1usize; n];
    let mut carries: Vec<bool> = (0..n).map(|e| e >= n_tets).collect();
    for &e in visited.iter().rev() {
        let e = e as usize;
        if parent[e] != u32::MAX {
            let above = parent[e] as usize;
            size[above] += size[e];
            carries[above] |= carries[e];
        }
    }
    let mut is_detached = vec![false; n];
    // Parents precede their children.
    for &e in &visited {
        let e = e as usize;
        if parent[e] == u32::MAX {
            continue;
        }
        let above = parent[e] as usize;
        let bridge = lowest[e] > order[above];
        is_detached[e] = is_detached[above] || (bridge && !carries[e] && (2..=MAX_DETACHED).contains(&size[e]));
    }
    is_detached
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of four that carries a prism, with a tail of two, a tail of one, and a tail that carries a prism.
    #[test]
    fn only_bare_tails_of_several_elements_hang() {
        let pairs = [[0, 1], [1, 2], [2, 3], [3, 0], [1, 4], [4, 5], [2, 6], [3, 7], [7, 8], [0, 9]];
        let is_detached = detached(10, 8, &pairs);
        let which: Vec<usize> = (0..10).filter(|&e| is_detached[e]).collect();
        assert_eq!(which, [4, 5]);
    }
}
