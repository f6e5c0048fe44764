use super::MixedMesh;
use super::adjacency::sorted;

/// Boundary triangles of the mesh, counter-clockwise seen from outside.
///
/// A triangle of a cell is on the boundary when no other cell has it. A prism's side is on the boundary when neither another
/// prism nor two triangles of tetrahedra cover it; it is split into two triangles.
#[must_use]
pub fn boundary_triangles(mesh: &MixedMesh) -> Vec<[u32; 3]> {
    boundary_of(&mesh.tetrahedra, &mesh.prisms).0
}

/// [`boundary_triangles`] of the given cells.
/// Also returns how many of them, counted from the first, are outer triangles of prisms.
#[must_use]
pub fn boundary_of(tetrahedra: &[[u32; 4]], prisms: &[[u32; 6]]) -> (Vec<[u32; 3]>, usize) {
    let outer = prisms.iter().map(|&[a, b, c, ..]| [a, b, c]);
    let inner = prisms.iter().map(|&[_, _, _, d, e, f]| [d, f, e]);
    let of_tetrahedra = tetrahedra.iter().flat_map(|&[a, b, c, d]| [[a, c, b], [a, b, d], [a, d, c], [b, c, d]]);
    let mut triangles: Vec<([u32; 3], [u32; 3], bool)> = (outer.map(|t| (t, true)))
        .chain(inner.chain(of_tetrahedra).map(|t| (t, false)))
        .map(|(t, is_outer)| (sorted(t), t, is_outer))
        .collect();
    triangles.sort_unstable_by_key(|(key, ..)| *key);
    let mut single: Vec<([u32; 3], [u32; 3], bool)> =
        triangles.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1).map(|same| same[0]).collect();
    let sides = prisms.iter().flat_map(|&[a, b, c, d, e, f]| [[b, a, d, e], [c, b, e, f], [a, c, f, d]]);
    let mut sides: Vec<([u32; 4], [u32; 4])> = sides.map(|side| (sorted(side), side)).collect();
    sides.sort_unstable_by_key(|(key, _)| *key);
    let mut split: Vec<[u32; 3]> = Vec::new();
    let mut covered: Vec<[u32; 3]> = Vec::new();
    for same in sides.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1) {
        let [a, b, c, d] = same[0].1;
        let halves = [[[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]];
        let has = |t: &[u32; 3]| single.binary_search_by_key(&sorted(*t), |(key, ..)| *key).is_ok();
        match halves.iter().find(|pair| pair.iter().all(has)) {
            // This side is covered by tetrahedra.
            Some(pair) => covered.extend(pair.map(sorted)),
            // The diagonal starts at the lowest node number, so it does not depend on which cell supplied the side.
            None => split.extend(if a.min(c) < b.min(d) { halves[0] } else { halves[1] }),
        }
    }
    covered.sort_unstable();
    single.retain(|(key, ..)| covered.binary_search(key).is_err());
    let (mut faces, others): (Vec<_>, Vec<_>) = single.into_iter().partition(|(.., is_outer)| *is_outer);
    let n_outer = faces.len();
    faces.extend(others);
    let mut faces: Vec<[u32; 3]> = faces.into_iter().map(|(_, t, _)| t).collect();
    faces.extend(split);
    (faces, n_outer)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A prism over a tetrahedron: the shared triangle is inside, and each side consists of two triangles.
    #[test]
    fn a_prism_on_a_tetrahedron_has_outer_triangle_six_halves_of_sides_and_three_faces() {
        let (faces, n_outer) = boundary_of(&[[3, 5, 4, 6]], &[[0, 1, 2, 3, 4, 5]]);
        assert_eq!((faces.len(), n_outer, faces[0]), (1 + 3 + 6, 1, [0, 1, 2]));
        // Closed surface: every edge is used once in each direction.
        let edges: Vec<[u32; 2]> = faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        assert!(edges.iter().all(|&[a, b]| edges.iter().filter(|e| **e == [b, a]).count() == 1));
    }

    /// Two tetrahedra that together cover a prism's side close it.
    #[test]
    fn a_side_on_two_triangles_is_inside() {
        // The side 0, 1, 4, 3, cut by its diagonal 0 4; 6 lies in front of it.
        let (faces, _) = boundary_of(&[[0, 1, 4, 6], [0, 4, 3, 6]], &[[0, 1, 2, 3, 4, 5]]);
        let is_side = |t: &[u32; 3]| t.iter().all(|n| [0, 1, 3, 4].contains(n));
        assert!(!faces.iter().any(is_side), "{faces:?}");
        assert_eq!(faces.len(), 2 + 4 + 4);
    }
}
