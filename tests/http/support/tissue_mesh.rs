//! Tissue meshes to upload.

use prosopon_formats::export::vtu;
use prosopon_geometry::Point;

/// A block of cubes of edge `edge` mm from the origin, six tetrahedra each; with `skin`, a layer of wedges 1.5 mm thick
/// on top.
pub(crate) struct Block {
    pub(crate) cells: [usize; 3],
    pub(crate) edge: f64,
    pub(crate) skin: bool,
}

impl Block {
    /// Point arrays are functions of the points: attachment, fixed_mask, force_n.
    pub(crate) fn vtu(
        &self,
        attachment: impl Fn(&Point) -> f64,
        mask: impl Fn(&Point) -> f64,
        force: impl Fn(&Point) -> [f64; 3],
    ) -> Vec<u8> {
        let [nx, ny, nz] = self.cells;
        let mut heights: Vec<f64> = (0..=nz).map(|k| self.edge * k as f64).collect();
        if self.skin {
            heights.push(self.edge * nz as f64 + 1.5);
        }
        let mut points = Vec::new();
        for i in 0..=nx {
            for j in 0..=ny {
                points.extend(heights.iter().map(|z| Point::new(self.edge * i as f64, self.edge * j as f64, *z)));
            }
        }
        let node = |i: usize, j: usize, k: usize| ((i * (ny + 1) + j) * heights.len() + k) as u32;
        let (mut tetrahedra, mut wedges) = (Vec::new(), Vec::new());
        for (i, j) in (0..nx).flat_map(|i| (0..ny).map(move |j| (i, j))) {
            for k in 0..nz {
                for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [2, 1, 0], [0, 2, 1]] {
                    let mut at = [i, j, k];
                    let mut corners = vec![node(i, j, k)];
                    for axis in order {
                        at[axis] += 1;
                        corners.push(node(at[0], at[1], at[2]));
                    }
                    // Half of them have reversed orientation; the reader corrects it.
                    tetrahedra.push([corners[0], corners[1], corners[2], corners[3]]);
                }
            }
            if self.skin {
                for corners in [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]] {
                    let [a, b, c] = corners.map(|(u, v)| node(i + u, j + v, nz + 1));
                    let [d, e, f] = corners.map(|(u, v)| node(i + u, j + v, nz));
                    wedges.push([a, b, c, d, e, f]);
                }
            }
        }
        let attachment: Vec<f64> = points.iter().map(attachment).collect();
        let mask: Vec<f64> = points.iter().map(mask).collect();
        let force: Vec<f64> = points.iter().flat_map(force).collect();
        let tissue: Vec<f64> = vec![2.0; tetrahedra.len()].into_iter().chain(vec![0.0; wedges.len()]).collect();
        let arrays: [(&str, usize, &[f64]); 3] =
            [("attachment", 1, &attachment), ("fixed_mask", 1, &mask), ("force_n", 3, &force)];
        vtu(&points, &tetrahedra, &wedges, &arrays, &[("tissue", 1, &tissue)])
    }
}

/// 30 x 30 x 6 mm under 1.5 mm of skin: sides fixed, the middle of the bottom with attachment `middle`.
pub(crate) fn slab(middle: f64) -> Vec<u8> {
    let block = Block { cells: [6, 6, 2], edge: 5.0, skin: true };
    let side = |p: &Point| p.x < 1e-9 || p.x > 30.0 - 1e-9 || p.y < 1e-9 || p.y > 30.0 - 1e-9;
    let inner = |p: &Point| p.z == 0.0 && (p.x - 15.0).abs().max((p.y - 15.0).abs()) < 11.0;
    let attachment = move |p: &Point| {
        if side(p) {
            0.0
        } else if inner(p) {
            middle
        } else {
            -1.0
        }
    };
    block.vtu(attachment, |_| 0.0, |_| [0.0; 3])
}
