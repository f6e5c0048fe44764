use crate::connectivity::Sets;
use crate::{Aabb, TriMesh};

/// Connected parts of a mesh; triangles are connected through shared vertices.
///
/// Each part is a list of triangle indices in rising order. Parts are sorted by their first triangle.
#[must_use]
pub fn parts(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let mut connected = Sets::new(mesh.positions().len());
    for &[a, b, c] in mesh.triangles() {
        connected.join(a, b);
        connected.join(b, c);
    }
    let mut part_of_root = vec![u32::MAX; mesh.positions().len()];
    let mut parts: Vec<Vec<u32>> = Vec::new();
    for (index, t) in mesh.triangles().iter().enumerate() {
        let part = &mut part_of_root[connected.find(t[0]) as usize];
        if *part == u32::MAX {
            *part = parts.len() as u32;
            parts.push(Vec::new());
        }
        parts[*part as usize].push(index as u32);
    }
    parts
}

/// The triangles `kept` of `mesh` with only the vertices that they use; `None` when `kept` is empty.
///
/// Triangles have the order of `kept`; vertices keep their order in `mesh`.
#[must_use]
pub fn submesh(mesh: &TriMesh, kept: &[u32]) -> Option<TriMesh> {
    let mut used = vec![false; mesh.positions().len()];
    for &t in kept {
        for v in mesh.triangles()[t as usize] {
            used[v as usize] = true;
        }
    }
    let mut renumbered = vec![0u32; used.len()];
    let mut positions = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        renumbered[v] = positions.len() as u32;
        positions.push(mesh.positions()[v]);
    }
    let triangles = kept.iter().map(|&t| mesh.triangles()[t as usize].map(|v| renumbered[v as usize])).collect();
    TriMesh::new(positions, triangles).ok()
}

/// Removes small connected parts; returns the mesh and the number of removed parts.
///
/// A part stays when the diagonal of its bounding box is at least `min_diagonal_mm`. The largest part always stays.
#[must_use]
pub fn drop_small_parts(mesh: &TriMesh, min_diagonal_mm: f64) -> (TriMesh, usize) {
    let parts = parts(mesh);
    let diagonals: Vec<f64> = parts.iter().map(|p| diagonal(mesh, p)).collect();
    let largest = diagonals.iter().copied().fold(0.0, f64::max);
    let stays = |d: f64| d >= min_diagonal_mm.min(largest);
    let dropped = diagonals.iter().filter(|d| !stays(**d)).count();
    let mut kept: Vec<u32> =
        parts.into_iter().zip(&diagonals).filter(|(_, d)| stays(**d)).flat_map(|(part, _)| part).collect();
    kept.sort_unstable();
    (submesh(mesh, &kept).unwrap_or_else(|| mesh.clone()), dropped)
}

fn diagonal(mesh: &TriMesh, part: &[u32]) -> f64 {
    let corners = part.iter().flat_map(|&t| mesh.triangles()[t as usize]).map(|v| &mesh.positions()[v as usize]);
    Aabb::of(corners).map_or(0.0, |b| b.diagonal())
}

/// The connected part with the largest bounding box, and the number of parts left out.
#[must_use]
pub fn largest_part(mesh: &TriMesh) -> (TriMesh, usize) {
    let parts = parts(mesh);
    let best = parts.iter().max_by(|a, b| diagonal(mesh, a).total_cmp(&diagonal(mesh, b)));
    match best.and_then(|part| submesh(mesh, part)) {
        Some(largest) => (largest, parts.len() - 1),
        None => (mesh.clone(), 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;

    /// Tetrahedra of the given sizes in a row, each followed by an unused vertex.
    fn row(sizes: &[f64]) -> TriMesh {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (i, &s) in sizes.iter().enumerate() {
            let (x, n) = (100.0 * i as f64, positions.len() as u32);
            positions.extend(
                [[0.0, 0.0, 0.0], [s, 0.0, 0.0], [0.0, s, 0.0], [0.0, 0.0, s], [50.0, 0.0, 0.0]]
                    .map(|p| Point::new(x + p[0], p[1], p[2])),
            );
            triangles.extend([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|t| t.map(|v| v + n)));
        }
        TriMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn small_parts_go_and_the_count_is_returned() {
        let mesh = row(&[1.0, 10.0, 2.0, 20.0]);
        assert_eq!(parts(&mesh).len(), 4);
        let (kept, dropped) = drop_small_parts(&mesh, 5.0);
        assert_eq!((kept.triangles().len(), kept.positions().len(), dropped), (8, 8, 2));
        assert!((kept.volume() - (1000.0 + 8000.0) / 6.0).abs() < 1e-9);
        assert_eq!(drop_small_parts(&mesh, 0.0), (drop_small_parts(&mesh, 0.0).0, 0));
    }

    #[test]
    fn the_largest_part_always_stays() {
        let mesh = row(&[1.0, 3.0]);
        let (kept, dropped) = drop_small_parts(&mesh, 1e6);
        assert_eq!((kept.triangles().len(), dropped), (4, 1));
        assert!((kept.volume() - 4.5).abs() < 1e-12);
        let (kept, dropped) = largest_part(&mesh);
        assert!((kept.volume() - 4.5).abs() < 1e-12);
        assert_eq!(dropped, 1);
    }
}
