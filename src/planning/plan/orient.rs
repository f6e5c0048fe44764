//! Consistent orientation of a triangulated cut.

use std::collections::BTreeMap;

use prosopon_geometry::TriMesh;

/// The same triangles, oriented consistently across edges of two triangles where that is possible.
pub(super) fn oriented(mesh: &TriMesh) -> TriMesh {
    let mut edges: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (t, corners) in mesh.triangles().iter().enumerate() {
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default().push(t);
        }
    }
    let mut triangles = mesh.triangles().to_vec();
    let mut seen = vec![false; triangles.len()];
    for start in 0..triangles.len() {
        let mut stack = vec![start];
        while let Some(t) = stack.pop() {
            if std::mem::replace(&mut seen[t], true) {
                continue;
            }
            for i in 0..3 {
                let (a, b) = (triangles[t][i], triangles[t][(i + 1) % 3]);
                let Some([one, two]) = edges.get(&(a.min(b), a.max(b))).map(Vec::as_slice) else { continue };
                let other = if *one == t { *two } else { *one };
                if seen[other] {
                    continue;
                }
                let same_way = (0..3).any(|j| (triangles[other][j], triangles[other][(j + 1) % 3]) == (a, b));
                if same_way {
                    triangles[other].swap(1, 2);
                }
                stack.push(other);
            }
        }
    }
    TriMesh::new(mesh.positions().to_vec(), triangles).unwrap_or_else(|_| mesh.clone())
}
