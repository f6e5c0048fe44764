//! Structured blocks of fat under skin.

use prosopon_geometry::{Point, Vector};
use prosopon_tissue::mesh::{Attachment, MixedMesh, Tissue};

/// A box of Kuhn tetrahedra, six per cell, with a layer of prisms on top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slab {
    /// Cells of tetrahedra along x, y, z.
    pub(super) cells: [usize; 3],
    /// Size of the part with tetrahedra along x, y, z, mm; centred in x and y, with its bottom at z = 0.
    pub(super) size_mm: [f64; 3],
    /// Thickness of the prism layer, mm; 0 for no prisms.
    pub(super) skin_mm: f64,
}

/// Order of the axes of each Kuhn tetrahedron, and whether its orientation must be reversed.
const KUHN: [([usize; 3], bool); 6] = [
    ([0, 1, 2], false),
    ([1, 2, 0], false),
    ([2, 0, 1], false),
    ([0, 2, 1], true),
    ([2, 1, 0], true),
    ([1, 0, 2], true),
];

impl Slab {
    /// Number of tetrahedra.
    pub(super) fn tetrahedra(&self) -> usize {
        6 * self.cells.iter().product::<usize>()
    }

    /// The mesh with all nodes free; its bone faces are the triangles of the bottom.
    pub(super) fn mesh(&self) -> MixedMesh {
        let [nx, ny, nz] = self.cells;
        let layers = nz + 1 + usize::from(self.skin_mm > 0.0);
        let node = |i: usize, j: usize, k: usize| ((i * (ny + 1) + j) * layers + k) as u32;
        let (mut tetrahedra, mut prisms, mut bone_faces) = (Vec::new(), Vec::new(), Vec::new());
        for (i, j) in (0..nx).flat_map(|i| (0..ny).map(move |j| (i, j))) {
            for (k, (path, odd)) in (0..nz).flat_map(|k| KUHN.map(|p| (k, p))) {
                let mut at = [i, j, k];
                let mut corners = [node(i, j, k); 4];
                for (corner, axis) in corners[1..].iter_mut().zip(path) {
                    at[axis] += 1;
                    *corner = node(at[0], at[1], at[2]);
                }
                if odd {
                    corners.swap(1, 2);
                }
                tetrahedra.push(corners);
            }
            for triangle in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                let at = |k: usize| triangle.map(|(a, b)| node(i + a, j + b, k));
                if self.skin_mm > 0.0 {
                    let ([a, b, c], [d, e, f]) = (at(nz + 1), at(nz));
                    prisms.push([a, b, c, d, e, f]);
                }
                let [a, b, c] = at(0);
                bone_faces.push([a, c, b]);
            }
        }
        let positions = self.positions(layers);
        MixedMesh {
            attachment: vec![Attachment::Free; positions.len()],
            tetrahedron_tissue: vec![Tissue::Fat; tetrahedra.len()],
            positions,
            tetrahedra,
            prisms,
            bone_faces,
            depth_cut_nodes: Vec::new(),
            facing: Vec::new(),
            prism_tissue: Vec::new(),
        }
    }

    /// Nodes, x slowest and z fastest.
    fn positions(&self, layers: usize) -> Vec<Point> {
        let [nx, ny, nz] = self.cells;
        let [x, y, z] = self.size_mm;
        let height = |k: usize| if k <= nz { z * k as f64 / nz as f64 } else { z + self.skin_mm };
        let place = |i: usize, j: usize, k: usize| {
            Point::new(x * (i as f64 / nx as f64 - 0.5), y * (j as f64 / ny as f64 - 0.5), height(k))
        };
        let columns = (0..=nx).flat_map(|i| (0..=ny).map(move |j| (i, j)));
        columns.flat_map(|(i, j)| (0..layers).map(move |k| place(i, j, k))).collect()
    }

    /// [`Slab::mesh`] with fixed sides and a patch of its bottom tied to segment 1.
    ///
    /// With r the larger of |x| and |y|, bottom nodes are tied for r up to `patch_mm` and fixed for r from `fixed_mm`.
    pub(super) fn over_a_patch(&self, patch_mm: f64, fixed_mm: f64) -> MixedMesh {
        let mut mesh = self.mesh();
        let side = 0.5 * self.size_mm[0];
        attach(&mut mesh, |p| {
            let r = p.x.abs().max(p.y.abs());
            match p.z == 0.0 {
                _ if r > side - 1e-6 => Attachment::Fixed,
                true if r >= fixed_mm => Attachment::Fixed,
                true if r <= patch_mm => Attachment::Tied(1),
                _ => Attachment::Free,
            }
        });
        mesh
    }
}

/// Sets the attachment of every node.
pub(super) fn attach(mesh: &mut MixedMesh, rule: impl Fn(&Point) -> Attachment) {
    mesh.attachment = mesh.positions.iter().map(rule).collect();
}

/// Displacements from rest.
pub(super) fn moved(mesh: &MixedMesh, now: &[Point]) -> Vec<Vector> {
    now.iter().zip(&mesh.positions).map(|(x, rest)| x - rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slab_fills_its_box_with_cells_that_are_not_inside_out() {
        let slab = Slab { cells: [4, 3, 2], size_mm: [8.0, 9.0, 5.0], skin_mm: 1.5 };
        let mesh = slab.mesh();
        let det = |[a, b, c, d]: [u32; 4]| {
            let p = |n: u32| mesh.positions[n as usize];
            (p(b) - p(a)).cross(&(p(c) - p(a))).dot(&(p(d) - p(a)))
        };
        assert!(mesh.tetrahedra.len() == slab.tetrahedra() && mesh.tetrahedra.iter().all(|t| det(*t) > 0.0));
        let volume = mesh.tetrahedra.iter().map(|t| det(*t) / 6.0).sum::<f64>();
        assert!((volume - 360.0).abs() < 1e-9, "{volume}");
        assert_eq!((mesh.prisms.len(), mesh.bone_faces.len()), (24, 24));
        let patch = slab.over_a_patch(2.1, 3.9);
        let count = |a: Attachment| patch.attachment.iter().filter(|b| **b == a).count();
        // x -2, 0, 2 and y -1.5, 1.5 of the bottom.
        assert_eq!(count(Attachment::Tied(1)), 6);
    }
}
