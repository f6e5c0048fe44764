//! A slab of tetrahedra under one layer of prisms, with displaced nodes.

use nalgebra::{Point3, Vector3};
use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue};

/// A slab: `cells` x `cells` columns of side 4, `layers` layers of tetrahedra of height 3, prisms of height 1.5 on top.
pub(crate) struct Slab {
    pub(crate) cells: usize,
    pub(crate) layers: usize,
    /// Displacement of inner nodes as a share of the cell.
    pub(crate) distortion: f64,
    /// Height added at (x, y), decreasing to 0 at the bottom.
    pub(crate) height: fn(f64, f64) -> f64,
}

impl Slab {
    pub(crate) const SIDE: f64 = 4.0;

    pub(crate) fn mesh(&self) -> MixedMesh {
        let n = self.cells + 1;
        let levels = self.layers + 2;
        let thickness =
            |level: usize| 3.0 * level.min(self.layers) as f64 + if level > self.layers { 1.5 } else { 0.0 };
        let total = thickness(levels - 1);
        let id = |i: usize, j: usize, level: usize| ((level * n + i) * n + j) as u32;
        let mut positions = Vec::new();
        for level in 0..levels {
            for i in 0..n {
                for j in 0..n {
                    let s = (7 * level + 3 * i + 5 * j + i * j) as f64;
                    let wobble =
                        Vector3::new((1.3 * s).sin(), (2.1 * s).cos(), (0.7 * s).sin() * 0.5) * self.distortion;
                    let (rim_i, rim_j) = (i == 0 || i == self.cells, j == 0 || j == self.cells);
                    let (rim_k, skin) = (level == 0, level + 1 == levels);
                    let mut p = Vector3::new(Self::SIDE * i as f64, Self::SIDE * j as f64, thickness(level));
                    p.x += if rim_i { 0.0 } else { Self::SIDE * wobble.x };
                    p.y += if rim_j { 0.0 } else { Self::SIDE * wobble.y };
                    p.z += if rim_k || skin { 0.0 } else { wobble.z };
                    p.z += (self.height)(p.x, p.y) * p.z / total;
                    positions.push(Point3::from(p));
                }
            }
        }
        let mut tetrahedra = Vec::new();
        let mut prisms = Vec::new();
        for (i, j) in (0..self.cells * self.cells).map(|c| (c / self.cells, c % self.cells)) {
            for level in 0..self.layers {
                // Kuhn's six tetrahedra: paths along the three axes in every order.
                for axes in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]] {
                    let mut at = [i, j, level];
                    let mut t = [id(at[0], at[1], at[2]); 4];
                    for (step, axis) in axes.into_iter().enumerate() {
                        at[axis] += 1;
                        t[step + 1] = id(at[0], at[1], at[2]);
                    }
                    let even = matches!(axes, [0, 1, 2] | [1, 2, 0] | [2, 0, 1]);
                    tetrahedra.push(if even { t } else { [t[0], t[2], t[1], t[3]] });
                }
            }
            let (top, low) = (levels - 1, levels - 2);
            for [a, b, c] in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                let at = |(u, v): (usize, usize), level| id(i + u, j + v, level);
                prisms.push([at(a, top), at(b, top), at(c, top), at(a, low), at(b, low), at(c, low)]);
            }
        }
        MixedMesh {
            attachment: vec![Attachment::Free; positions.len()],
            positions,
            tetrahedron_tissue: vec![Tissue::Fat; tetrahedra.len()],
            tetrahedra,
            prisms,
            bone_faces: Vec::new(),
            depth_cut_nodes: Vec::new(),
            facing: Vec::new(),
            prism_tissue: Vec::new(),
        }
    }

    /// Whether the node lies on the sides or the bottom, and whether it lies on the skin.
    pub(crate) fn held_and_skin(&self, node: usize) -> (bool, bool) {
        let n = self.cells + 1;
        let (level, i, j) = (node / (n * n), node / n % n, node % n);
        let side = i == 0 || j == 0 || i == self.cells || j == self.cells;
        (side || level == 0, level == self.layers + 1)
    }
}
