use rayon::prelude::*;

/// Corners of the face opposite corner `i` of a tetrahedron of positive volume, counter-clockwise seen from outside.
const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

pub(super) fn face_of(t: &[u32; 4], opposite: usize) -> [u32; 3] {
    FACES[opposite].map(|i| t[i])
}

pub(super) fn sorted<const N: usize>(mut nodes: [u32; N]) -> [u32; N] {
    nodes.sort_unstable();
    nodes
}

/// A face of one tetrahedron: sorted nodes, tetrahedron, opposite corner.
type Slot = ([u32; 3], u32, u8);

fn slots(tetrahedra: &[[u32; 4]]) -> Vec<Slot> {
    let mut all: Vec<Slot> = Vec::with_capacity(4 * tetrahedra.len());
    for (t, nodes) in tetrahedra.iter().enumerate() {
        for i in 0..4 {
            all.push((sorted(face_of(nodes, i)), t as u32, i as u8));
        }
    }
    all.par_sort_unstable();
    all
}

/// Boundary triangle of a set of tetrahedra.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BoundaryFace {
    /// Counter-clockwise seen from outside.
    pub(super) nodes: [u32; 3],
    pub(super) tetrahedron: u32,
}

/// Faces that belong to one tetrahedron only, ordered by their sorted nodes.
pub(super) fn boundary(tetrahedra: &[[u32; 4]]) -> Vec<BoundaryFace> {
    slots(tetrahedra)
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|same| same.len() == 1)
        .map(|same| {
            let (_, t, i) = same[0];
            BoundaryFace { nodes: face_of(&tetrahedra[t as usize], i as usize), tetrahedron: t }
        })
        .collect()
}

/// Pairs of tetrahedra that share a face, and the number of faces shared by more than two.
pub(super) fn shared_faces(tetrahedra: &[[u32; 4]]) -> (Vec<[u32; 2]>, usize) {
    let mut pairs = Vec::with_capacity(2 * tetrahedra.len());
    let mut crowded = 0;
    for same in slots(tetrahedra).chunk_by(|a, b| a.0 == b.0) {
        match same {
            [_] => {}
            [a, b] => pairs.push([a.1, b.1]),
            _ => crowded += 1,
        }
    }
    (pairs, crowded)
}

/// Rows of indices of varying length.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Rows {
    /// Row `r` lists the second members of all pairs `(r, item)`, in the order given.
    pub(super) fn of(n_rows: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0u32; n_rows + 1];
        for (row, _) in pairs.clone() {
            starts[row as usize + 1] += 1;
        }
        for r in 0..n_rows {
            starts[r + 1] += starts[r];
        }
        let mut next = starts.clone();
        let mut items = vec![0; starts[n_rows] as usize];
        for (row, item) in pairs {
            let at = &mut next[row as usize];
            items[*at as usize] = item;
            *at += 1;
        }
        Self { starts, items }
    }

    /// Elements at each node.
    pub(super) fn incidence<const N: usize>(n_nodes: usize, elements: &[[u32; N]]) -> Self {
        Self::of(n_nodes, elements.iter().enumerate().flat_map(|(e, nodes)| nodes.iter().map(move |&n| (n, e as u32))))
    }

    pub(super) fn row(&self, r: usize) -> &[u32] {
        &self.items[self.starts[r] as usize..self.starts[r + 1] as usize]
    }
}

/// Divides `nodes` into groups without two nodes of one element, so that threads may move the nodes of a group side by side.
///
/// `at` lists the elements at each node. A node comes after its neighbours that precede it in `nodes`: group after group gives
/// the same as node after node.
pub(super) fn side_by_side<const N: usize>(nodes: &[u32], elements: &[[u32; N]], at: &Rows) -> Vec<Vec<u32>> {
    // Group after that of each node; 0 for nodes that had no turn yet.
    let mut after = vec![0usize; at.starts.len().saturating_sub(1)];
    let mut groups: Vec<Vec<u32>> = Vec::new();
    for &node in nodes {
        let neighbours = at.row(node as usize).iter().flat_map(|&e| elements[e as usize]);
        let group = neighbours.map(|n| after[n as usize]).max().unwrap_or(0);
        if group == groups.len() {
            groups.push(Vec::new());
        }
        groups[group].push(node);
        after[node as usize] = group + 1;
    }
    groups
}

/// Number of each item's group when the pairs are joined; groups are numbered in order of their first item.
pub(super) fn groups(n: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for [a, b] in pairs {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        // The smallest member is the root: numbering does not depend on the order of pairs.
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut number = vec![u32::MAX; n];
    let mut next = 0;
    (0..n as u32)
        .map(|i| {
            let r = root(&mut parent, i) as usize;
            if number[r] == u32::MAX {
                number[r] = next;
                next += 1;
            }
            number[r]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_tetrahedra_share_one_face() {
        let tetrahedra = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let faces = boundary(&tetrahedra);
        assert_eq!(faces.len(), 6);
        assert!(faces.iter().all(|f| sorted(f.nodes) != [1, 2, 3]));
        assert_eq!(shared_faces(&tetrahedra), (vec![[0, 1]], 0));
        let rows = Rows::incidence(5, &tetrahedra);
        assert_eq!(rows.row(0), [0]);
        assert_eq!(rows.row(3), [0, 1]);
    }

    #[test]
    fn groups_are_numbered_by_first_item() {
        assert_eq!(groups(6, [[4, 2], [5, 0], [2, 1]].into_iter()), [0, 1, 1, 2, 1, 0]);
    }

    #[test]
    fn group_after_group_gives_the_same_as_node_after_node() {
        // A strip of triangles; each move takes the sum of the neighbours.
        let faces: Vec<[u32; 3]> = (0..40).map(|n| [n, n + 1, n + 2]).collect();
        let at = Rows::incidence(42, &faces);
        // Each node once, in leaps of five.
        let nodes: Vec<u32> = (0..42).map(|n| 5 * n % 42).collect();
        let moved = |values: &[u64], node: u32| -> u64 {
            let around = at.row(node as usize).iter().flat_map(|&f| faces[f as usize]);
            around.map(|n| values[n as usize]).fold(u64::from(node), |sum, v| sum.wrapping_mul(3).wrapping_add(v))
        };
        let mut in_turn: Vec<u64> = (0..42).collect();
        for &node in &nodes {
            in_turn[node as usize] = moved(&in_turn, node);
        }
        let mut by_group: Vec<u64> = (0..42).collect();
        let groups = side_by_side(&nodes, &faces, &at);
        for group in &groups {
            let found: Vec<u64> = group.iter().map(|&node| moved(&by_group, node)).collect();
            group.iter().zip(found).for_each(|(&node, value)| by_group[node as usize] = value);
        }
        assert_eq!(by_group, in_turn);
        assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), nodes.len());
        assert!(groups.iter().any(|group| group.len() > 1), "{groups:?}");
    }
}
