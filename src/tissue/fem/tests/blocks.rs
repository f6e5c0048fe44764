//! Structured meshes.

use crate::mesh::{Attachment, MixedMesh, Tissue};
use prosopon_geometry::{Point, Vector};

/// A box of Kuhn tetrahedra, six for each cell, with a layer of prisms on top when `skin > 0`.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct Slab {
    pub(in crate::fem) cells: [usize; 3],
    pub(in crate::fem) origin: [f64; 3],
    /// Size of the part with tetrahedra, mm.
    pub(in crate::fem) size: [f64; 3],
    /// Thickness of the prisms, mm.
    pub(in crate::fem) skin: f64,
}

impl Slab {
    /// Mesh of fat and skin with all nodes [`Attachment::Free`]; nodes are numbered with x slowest and z fastest. Bone faces
    /// are the triangles of the bottom.
    pub(in crate::fem) fn mesh(&self) -> MixedMesh {
        let [nx, ny, nz] = self.cells;
        let layers = nz + 1 + usize::from(self.skin > 0.0);
        let mut positions = Vec::new();
        for i in 0..=nx {
            for j in 0..=ny {
                for k in 0..layers {
                    let share = |a: usize, n: usize, axis: usize| self.size[axis] * a as f64 / n as f64;
                    let z = if k <= nz { share(k, nz, 2) } else { self.size[2] + self.skin };
                    let p = Vector::new(share(i, nx, 0), share(j, ny, 1), z) + Vector::from(self.origin);
                    positions.push(Point::from(p));
                }
            }
        }
        let node = |i: usize, j: usize, k: usize| ((i * (ny + 1) + j) * layers + k) as u32;
        let mut tetrahedra = Vec::new();
        let mut prisms = Vec::new();
        let mut bone_faces = Vec::new();
        for i in 0..nx {
            for j in 0..ny {
                for k in 0..nz {
                    // All paths from corner (0, 0, 0) to (1, 1, 1) along axes; odd permutations invert the tetrahedron.
                    for (path, odd) in
                        [([0, 1, 2], 0), ([1, 2, 0], 0), ([2, 0, 1], 0), ([0, 2, 1], 1), ([2, 1, 0], 1), ([1, 0, 2], 1)]
                    {
                        let mut at = [i, j, k];
                        let mut corners = [node(i, j, k); 4];
                        for (step, axis) in path.iter().enumerate() {
                            at[*axis] += 1;
                            corners[step + 1] = node(at[0], at[1], at[2]);
                        }
                        if odd == 1 {
                            corners.swap(1, 2);
                        }
                        tetrahedra.push(corners);
                    }
                }
                for triangle in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                    let at = |k: usize| triangle.map(|(a, b)| node(i + a, j + b, k));
                    if self.skin > 0.0 {
                        let ([a, b, c], [d, e, f]) = (at(nz + 1), at(nz));
                        prisms.push([a, b, c, d, e, f]);
                    }
                    let [a, b, c] = at(0);
                    bone_faces.push([a, c, b]);
                }
            }
        }
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
}

/// Sets the attachment of every node for which `rule` returns one.
pub(super) fn attach(mesh: &mut MixedMesh, rule: impl Fn(&Point) -> Option<Attachment>) {
    for (p, a) in mesh.positions.iter().zip(&mut mesh.attachment) {
        if let Some(attachment) = rule(p) {
            *a = attachment;
        }
    }
}
