//! One side of tissue that faces tissue: triangles, their neighbours, and the signed distance to them.

use super::boxes::{Bounds, BoxTree, bounds};
use super::closest::{Closest, Feature, closest};
use crate::fem::tuning::COINCIDENT_MM;
use prosopon_geometry::Vector;
use std::collections::BTreeMap;

const NONE: u32 = u32::MAX;

/// Triangles that may be touched.
#[derive(Debug, Clone)]
pub(super) struct Patch {
    pub(super) triangles: Vec<[u32; 3]>,
    /// Neighbour across the edge from each corner to the next; [`NONE`] at the rim.
    neighbours: Vec<[u32; 3]>,
    /// Triangles round each node.
    stars: BTreeMap<u32, Vec<u32>>,
    /// Nodes at the rim, ascending.
    rim: Vec<u32>,
    tree: BoxTree,
}

/// Current shape of a patch.
#[derive(Debug)]
pub(super) struct Shape {
    /// Unit normals, out of the tissue; zero for a triangle without area.
    pub(super) normals: Vec<Vector>,
    boxes: Vec<Bounds>,
}

/// The point of a patch that is nearest to a given one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// Signed distance, mm; negative inside the tissue.
    pub(super) gap: f64,
    /// Gradient of the distance with respect to the given point.
    pub(super) normal: Vector,
    /// Nodes of the nearest face, edge or corner first, and their weights.
    pub(super) nodes: [u32; 3],
    pub(super) weights: [f64; 3],
    /// 3 in a face, 2 on an edge, 1 at a corner.
    pub(super) n_nodes: usize,
}

impl Patch {
    pub(super) fn new(triangles: &[[u32; 3]], x: &[Vector]) -> Self {
        let mut by_edge: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut stars: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (t, nodes) in triangles.iter().enumerate() {
            for i in 0..3 {
                by_edge.insert((nodes[i], nodes[(i + 1) % 3]), t as u32);
                stars.entry(nodes[i]).or_default().push(t as u32);
            }
        }
        let across = |a: u32, b: u32| by_edge.get(&(b, a)).copied().unwrap_or(NONE);
        let neighbours: Vec<[u32; 3]> =
            triangles.iter().map(|[a, b, c]| [across(*a, *b), across(*b, *c), across(*c, *a)]).collect();
        let mut rim: Vec<u32> = (triangles.iter().zip(&neighbours))
            .flat_map(|(nodes, beside)| {
                (0..3).filter(|i| beside[*i] == NONE).flat_map(|i| [nodes[i], nodes[(i + 1) % 3]])
            })
            .collect();
        rim.sort_unstable();
        rim.dedup();
        let centres: Vec<Vector> =
            triangles.iter().map(|t| t.iter().map(|n| x[*n as usize]).sum::<Vector>() / 3.0).collect();
        Self { triangles: triangles.to_vec(), neighbours, stars, rim, tree: BoxTree::new(&centres) }
    }

    /// Corners of a triangle.
    pub(super) fn corners(&self, triangle: u32, x: &[Vector]) -> [Vector; 3] {
        self.triangles[triangle as usize].map(|n| x[n as usize])
    }

    pub(super) fn shape(&self, x: &[Vector]) -> Shape {
        let normal = |nodes: &[u32; 3]| {
            let [a, b, c] = nodes.map(|n| x[n as usize]);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector::zeros)
        };
        let normals = self.triangles.iter().map(normal).collect();
        Shape { normals, boxes: self.tree.boxes(|t| bounds(&self.corners(t, x))) }
    }

    /// Triangles near a box, ascending.
    pub(super) fn near(&self, shape: &Shape, wanted: &Bounds) -> Vec<u32> {
        let mut found = Vec::new();
        self.tree.query(&shape.boxes, wanted, |t| found.push(t));
        found.sort_unstable();
        found
    }

    /// Triangles that share a node with `nodes`, ascending.
    pub(super) fn around(&self, nodes: &[u32; 3]) -> Vec<u32> {
        let mut found: Vec<u32> = nodes.iter().filter_map(|n| self.stars.get(n)).flatten().copied().collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// The nearest point among the triangles `candidates`. `None` when the given point lies beside the rim, where the patch has no
    /// inside, or when its nearest triangle is one of `skipped` (ascending).
    pub(super) fn nearest(
        &self,
        shape: &Shape,
        (candidates, skipped): (&[u32], &[u32]),
        p: &Vector,
        x: &[Vector],
    ) -> Option<Nearest> {
        let mut best: Option<(f64, u32, Closest)> = None;
        for &t in candidates {
            let found = closest(p, &self.corners(t, x));
            let distance_sq = found.away.norm_squared();
            if best.is_none_or(|(least, _, _)| distance_sq < least) {
                best = Some((distance_sq, t, found));
            }
        }
        let (distance_sq, t, Closest { feature, weights, away }) = best?;
        if skipped.binary_search(&t).is_ok() {
            return None;
        }
        let nodes = self.triangles[t as usize];
        let (outward, order, n_nodes) = match feature {
            Feature::Face => (shape.normals[t as usize], [0, 1, 2], 3),
            Feature::Edge(i) => {
                let beside = self.neighbours[t as usize][i];
                let other = shape.normals.get(beside as usize)?;
                (shape.normals[t as usize] + other, [i, (i + 1) % 3, (i + 2) % 3], 2)
            }
            Feature::Corner(i) => {
                if self.rim.binary_search(&nodes[i]).is_ok() {
                    return None;
                }
                (self.corner_normal(shape, nodes[i], x), [i, (i + 1) % 3, (i + 2) % 3], 1)
            }
        };
        let outward = outward.try_normalize(0.0)?;
        let (distance, side) = (distance_sq.sqrt(), away.dot(&outward));
        // On the surface itself the direction to the nearest point is rounding.
        let (gap, normal) = if n_nodes == 3 || distance < COINCIDENT_MM {
            (side, outward)
        } else {
            (distance.copysign(side), away * (1f64.copysign(side) / distance))
        };
        Some(Nearest { gap, normal, nodes: order.map(|i| nodes[i]), weights: order.map(|i| weights[i]), n_nodes })
    }

    /// Sum of the normals round a node, weighted by the angles at it. Its sign tells inside from outside (Bærentzen and Aanæs,
    /// IEEE Trans. Vis. Comput. Graph. 11 (2005)).
    fn corner_normal(&self, shape: &Shape, node: u32, x: &[Vector]) -> Vector {
        let at = |t: &u32| {
            let nodes = self.triangles[*t as usize];
            let i = nodes.iter().position(|n| *n == node).unwrap_or(0);
            let [a, b, c] = [i, (i + 1) % 3, (i + 2) % 3].map(|i| x[nodes[i] as usize]);
            shape.normals[*t as usize] * (b - a).angle(&(c - a))
        };
        self.stars.get(&node).into_iter().flatten().map(at).sum()
    }
}
