//! Small surfaces with known distances.

use crate::geometry::{Point, TriMesh, Vector};
use std::collections::BTreeMap;

/// Sphere around `center`: an icosahedron divided `levels` times.
pub(super) fn sphere(center: Point, radius: f64, levels: usize) -> TriMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut p: Vec<Vector> = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(|c| Vector::from(c).normalize())
    .to_vec();
    let mut t: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32, p: &mut Vec<Vector>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                p.push((p[a as usize] + p[b as usize]).normalize());
                p.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for [a, b, c] in t {
            let (ab, bc, ca) = (middle(a, b, &mut p), middle(b, c, &mut p), middle(c, a, &mut p));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        t = finer;
    }
    TriMesh::new(p.into_iter().map(|v| center + v * radius).collect(), t).unwrap()
}

/// Box with half-sizes `half`, two triangles a face.
pub(super) fn block(center: Point, half: Vector) -> TriMesh {
    let p = (0..8)
        .map(|n| {
            let s = |bit: usize| if n >> bit & 1 == 1 { 1.0 } else { -1.0 };
            center + Vector::new(s(0) * half.x, s(1) * half.y, s(2) * half.z)
        })
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let t = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh::new(p, t).unwrap()
}

/// Signed distance to [`block`].
pub(super) fn block_distance(center: Point, half: Vector, p: &Point) -> f64 {
    let q = (p - center).abs() - half;
    q.sup(&Vector::zeros()).norm() + q.max().min(0.0)
}

/// `mesh` with only the triangles that `keep` (index, corners) wants.
pub(super) fn filtered(mesh: &TriMesh, keep: impl Fn(usize, [Point; 3]) -> bool) -> TriMesh {
    let t = mesh.triangles().iter().enumerate().filter(|(n, _)| keep(*n, mesh.corners(*n))).map(|(_, t)| *t).collect();
    TriMesh::new(mesh.positions().to_vec(), t).unwrap()
}

/// `mesh` with the triangles that `flip` wants turned over.
pub(super) fn flipped(mesh: &TriMesh, flip: impl Fn(usize) -> bool) -> TriMesh {
    let t = mesh.triangles().iter().enumerate().map(|(n, &[a, b, c])| if flip(n) { [a, c, b] } else { [a, b, c] });
    TriMesh::new(mesh.positions().to_vec(), t.collect()).unwrap()
}

/// Both surfaces in one.
pub(super) fn joined(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let shift = a.positions().len() as u32;
    let positions = a.positions().iter().chain(b.positions()).copied().collect();
    let triangles = a.triangles().iter().copied().chain(b.triangles().iter().map(|t| t.map(|v| v + shift)));
    TriMesh::new(positions, triangles.collect()).unwrap()
}

/// Pseudo-random numbers in [0, 1), the same on every run.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Point of the cube with half-size `half` around `center`.
    pub(super) fn point(&mut self, center: Point, half: f64) -> Point {
        center + Vector::from_fn(|_, _| (2.0 * self.unit() - 1.0) * half)
    }
}
