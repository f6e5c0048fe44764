//! Refines triangles where the skin is strongly curved.
//! Edges under the skin are split together with their tetrahedra, so that the flat outer triangles of the prisms follow the
//! skin.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::adjacency::sorted;
use super::domain::{Foot, InnerTissue, Side};
use super::prisms::{PrismLayer, stand_off};
use super::quality::smallest_sine;
use super::stuffing::TetMesh;
use super::tuning::{
    FLATTEST_SINE, SHORTEST_SPLIT_EDGES, SPLIT_JACOBIAN_FLOOR, SPLIT_JACOBIAN_SHARE, SPLIT_ROUNDS, SPLIT_SINE_SHARE,
    TARGET_SKIN_DISTANCE_MM,
};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// A boundary triangle of the stuffed tissue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SurfaceFace {
    /// Counter-clockwise seen from outside.
    pub(super) nodes: [u32; 3],
    /// Whether a prism will stand on it.
    pub(super) skin: bool,
}

/// Nodes, their labels and the boundary, which a refinement extends together.
pub(super) struct Refinement<'a, 'd> {
    pub(super) inner: &'a InnerTissue<'d>,
    pub(super) mesh: &'a mut TetMesh,
    pub(super) sides: &'a mut Vec<Option<Side>>,
    /// Whether a node must stay in place.
    pub(super) pinned: &'a mut Vec<bool>,
    pub(super) faces: &'a mut Vec<SurfaceFace>,
    /// Prisms; each node of a face with a prism has an outer node.
    pub(super) layer: &'a mut PrismLayer,
    /// Edges that are not split because the result would be badly shaped.
    pub(super) refused: BTreeSet<[u32; 2]>,
}

/// Elements at the edges of the skin's triangles: `(edge, element)`, rising.
struct AtEdges(Vec<([u32; 2], u32)>);

impl AtEdges {
    fn row(&self, edge: [u32; 2]) -> impl Iterator<Item = usize> {
        let start = self.0.partition_point(|e| e.0 < edge);
        self.0[start..].iter().take_while(move |e| e.0 == edge).map(|e| e.1 as usize)
    }
}

const CORNER_PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

impl Refinement<'_, '_> {
    /// Splits edges until every outer triangle follows the skin or its edges are short; returns the number of splits.
    pub(super) fn run(&mut self, control: &Control) -> Result<usize, Cancelled> {
        let mut n_splits = 0;
        for _ in 0..SPLIT_ROUNDS {
            control.check()?;
            let edges = self.edges_to_split();
            if edges.is_empty() {
                break;
            }
            n_splits += self.split(edges);
        }
        Ok(n_splits)
    }

    /// Longest edges (of a triangle and of its neighbour across) near the triangles that are off the skin.
    fn edges_to_split(&self) -> Vec<[u32; 2]> {
        let top = |face: &[u32; 3]| -> Option<[Point; 3]> {
            let [a, b, c] = face.map(|n| self.layer.outer_nodes[n as usize].map(|f| f.point));
            Some([a?, b?, c?])
        };
        let bad: Vec<u32> = self
            .faces
            .par_iter()
            .enumerate()
            .filter(|(_, f)| f.skin)
            .filter_map(|(i, f)| {
                top(&f.nodes).filter(|t| stand_off(self.inner, t) > TARGET_SKIN_DISTANCE_MM).map(|_| i as u32)
            })
            .collect();
        if bad.is_empty() {
            return Vec::new();
        }
        let mut at: Vec<([u32; 2], u32)> = Vec::new();
        for (i, f) in self.faces.iter().enumerate().filter(|(_, f)| f.skin) {
            at.extend(edges_of(f.nodes).map(|e| (e, i as u32)));
        }
        at.sort_unstable();
        let at = AtEdges(at);
        let least = SHORTEST_SPLIT_EDGES * self.inner.edge;
        // Sum of the lengths of the outer and the inner edge; 0 when the edge must not be split.
        let length = |e: [u32; 2]| match e.map(|n| self.layer.outer_nodes[n as usize]) {
            [Some(a), Some(b)] if !self.refused.contains(&e) => {
                let [c, d] = e.map(|n| self.mesh.positions[n as usize]);
                let (above, below) = ((a.point - b.point).norm(), (c - d).norm());
                if above.min(below) < least { 0.0 } else { above + below }
            }
            _ => 0.0,
        };
        // Node numbers break ties, so that neighbours agree on an order.
        let longest = |face: usize| {
            let [a, b, c] = edges_of(self.faces[face].nodes).map(|e| (length(e), e));
            let more = |x: (f64, [u32; 2]), y: (f64, [u32; 2])| {
                if x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)).is_gt() { x } else { y }
            };
            more(more(a, b), c)
        };
        let mut chosen = Vec::new();
        for &face in &bad {
            let mut best = longest(face as usize);
            if best.0 == 0.0 {
                continue;
            }
            // Longest-edge propagation: the lengths strictly increase, so the search ends.
            loop {
                let next = at.row(best.1).map(longest).fold(best, |x, y| if y.0 > x.0 { y } else { x });
                if next.1 == best.1 {
                    break;
                }
                best = next;
            }
            chosen.push(best);
        }
        chosen.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
        chosen.dedup();
        chosen.into_iter().map(|c| c.1).collect()
    }

    /// Splits the edges in the order given, skipping those that share an element with an earlier one. Returns the number of
    /// splits.
    fn split(&mut self, edges: Vec<[u32; 2]>) -> usize {
        let mut wanted = edges.clone();
        wanted.sort_unstable();
        let is_wanted = |e: [u32; 2]| wanted.binary_search(&e).is_ok();
        let mut tets: Vec<([u32; 2], u32)> = self
            .mesh
            .tetrahedra
            .par_iter()
            .enumerate()
            .flat_map_iter(|(t, nodes)| {
                CORNER_PAIRS
                    .map(|[i, j]| (sorted([nodes[i], nodes[j]]), t as u32))
                    .into_iter()
                    .filter(|e| is_wanted(e.0))
            })
            .collect();
        tets.par_sort_unstable();
        let mut faces: Vec<([u32; 2], u32)> = Vec::new();
        for (i, f) in self.faces.iter().enumerate() {
            faces.extend(edges_of(f.nodes).into_iter().filter(|e| is_wanted(*e)).map(|e| (e, i as u32)));
        }
        faces.sort_unstable();
        let (tets, faces) = (AtEdges(tets), AtEdges(faces));
        let mut tet_done = vec![false; self.mesh.tetrahedra.len()];
        let mut face_done = vec![false; self.faces.len()];
        let mut n_splits = 0;
        for edge in edges {
            let at_tets: Vec<usize> = tets.row(edge).collect();
            let at_faces: Vec<usize> = faces.row(edge).collect();
            if at_tets.iter().any(|&t| tet_done[t]) || at_faces.iter().any(|&f| face_done[f]) {
                continue;
            }
            let Some(middle) = self.add_middle(edge, &at_tets, &at_faces) else {
                self.refused.insert(edge);
                continue;
            };
            at_tets.iter().for_each(|&t| tet_done[t] = true);
            at_faces.iter().for_each(|&f| face_done[f] = true);
            for &t in &at_tets {
                let old = self.mesh.tetrahedra[t];
                self.mesh.tetrahedra[t] = with(old, edge[0], middle);
                self.mesh.tetrahedra.push(with(old, edge[1], middle));
            }
            for &f in &at_faces {
                let old = self.faces[f];
                self.faces[f].nodes = with(old.nodes, edge[0], middle);
                self.faces.push(SurfaceFace { nodes: with(old.nodes, edge[1], middle), ..old });
            }
            n_splits += 1;
        }
        n_splits
    }

    /// Candidate skin points for the midpoint of two outer nodes.
    /// The first lies along the mean of their normals: on a ridge this is the crest, while the closest point lies on a
    /// flank. The second lies along the normal of the faces below, which leads up a thin fold. The third is the closest point.
    fn outer_nodes_between(&self, a: &Foot, b: &Foot, faces: &[[u32; 3]]) -> Vec<Option<Foot>> {
        let middle = nalgebra::center(&a.point, &b.point);
        let below: Vector = faces
            .iter()
            .map(|f| {
                let [p, q, r] = f.map(|n| self.mesh.positions[n as usize]);
                (q - p).cross(&(r - p))
            })
            .sum();
        let along = |normal: Vector, least: f64, reach: f64| {
            normal.try_normalize(least).and_then(|n| self.inner.foot_along(&middle, &n, reach))
        };
        let found = [
            along(a.normal + b.normal, 0.2, 0.75 * (a.point - b.point).norm()),
            along(below, 1e-9, self.inner.edge),
            self.inner.foot(&middle, self.inner.edge),
        ];
        found.into_iter().filter(Option::is_some).collect()
    }

    /// Adds a node halfway along `edge`, on the surface that both ends share; `None` when elements would be badly shaped.
    fn add_middle(&mut self, edge: [u32; 2], at_tets: &[usize], at_faces: &[usize]) -> Option<u32> {
        let [a, b] = edge.map(|n| n as usize);
        let skin_faces: Vec<[u32; 3]> =
            at_faces.iter().map(|&f| &self.faces[f]).filter(|f| f.skin).map(|f| f.nodes).collect();
        let candidates = match (self.layer.outer_nodes[a], self.layer.outer_nodes[b]) {
            (Some(a), Some(b)) => self.outer_nodes_between(&a, &b, &skin_faces),
            _ => vec![None],
        };
        let middle = nalgebra::center(&self.mesh.positions[a], &self.mesh.positions[b]);
        let both_below_skin = [a, b].iter().all(|&n| self.sides[n] == Some(Side::Skin) && !self.pinned[n]);
        let on_surface =
            if both_below_skin { self.inner.project(Side::Skin, &middle, 0.5 * self.inner.edge) } else { None };
        let worst = |p: &Point| {
            at_tets
                .iter()
                .flat_map(|&t| edge.map(|end| (self.mesh.tetrahedra[t], end)))
                .map(|(nodes, end)| {
                    smallest_sine(&nodes.map(|n| if n == end { *p } else { self.mesh.positions[n as usize] }))
                })
                .fold(f64::INFINITY, f64::min)
        };
        let straight = worst(&middle);
        let place = on_surface.filter(|p| worst(p) >= SPLIT_SINE_SHARE * straight).unwrap_or(middle);
        if worst(&place) < FLATTEST_SINE {
            return None;
        }
        let node = self.mesh.positions.len() as u32;
        self.mesh.positions.push(place);
        self.layer.outer_nodes.push(None);
        let floors: Vec<f64> = skin_faces
            .iter()
            .map(|nodes| (SPLIT_JACOBIAN_SHARE * self.layer.quality(self.mesh, nodes)).min(SPLIT_JACOBIAN_FLOOR))
            .collect();
        // Smallest margin over the limits; without prisms no limit applies.
        let mut best: Option<(f64, Option<Foot>)> = None;
        for foot in candidates {
            self.layer.outer_nodes[node as usize] = foot;
            let halves = skin_faces.iter().zip(&floors).flat_map(|(nodes, floor)| {
                edge.map(|end| self.layer.quality(self.mesh, &with(*nodes, end, node)) - floor)
            });
            let surplus = halves.fold(f64::INFINITY, f64::min);
            if surplus >= 0.0 && best.is_none_or(|(most, _)| surplus > most) {
                best = Some((surplus, foot));
            }
        }
        let Some((_, foot)) = best else {
            self.mesh.positions.pop();
            self.layer.outer_nodes.pop();
            return None;
        };
        self.layer.outer_nodes[node as usize] = foot;
        // A dropped node and one on the level set share no surface on which the midpoint could move.
        self.pinned.push(!both_below_skin && (self.sides[a] != self.sides[b] || self.pinned[a] || self.pinned[b]));
        self.sides.push(if self.sides[a] == Some(Side::Skin) { self.sides[b] } else { self.sides[a] });
        Some(node)
    }
}

fn edges_of([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [sorted([a, b]), sorted([b, c]), sorted([c, a])]
}

fn with<const N: usize>(nodes: [u32; N], old: u32, new: u32) -> [u32; N] {
    nodes.map(|n| if n == old { new } else { n })
}

#[cfg(test)]
mod tests {
    use super::super::adjacency::boundary;
    use super::super::domain::{Domain, MeshSettings, Region};
    use super::super::quality::tetrahedron_volume;
    use super::super::stuffing::{lattice_over, refine, stuff};
    use super::super::test_domain::{Nothing, Shape};
    use super::*;
    use prosopon_geometry::Aabb;

    fn refined(radius: f64) -> (TetMesh, Vec<SurfaceFace>, usize, f64) {
        let skin = Shape::ball(Point::origin(), radius);
        let reach = Vector::repeat(radius + 3.0);
        let region =
            Region { bounds: Aabb { min: Point::origin() - reach, max: Point::origin() + reach }, half_spaces: vec![] };
        let domain = Domain { skin: &skin, bone: &Nothing, air: None, soft_tissue: None, region: &region };
        let inner = InnerTissue::new(&domain, &MeshSettings { depth_mm: 100.0, ..MeshSettings::default() });
        let mut mesh =
            stuff(&inner, &refine(lattice_over(&inner, 4.0).unwrap(), vec![], 4.0).unwrap(), &Control::new()).unwrap();
        let mut faces: Vec<SurfaceFace> =
            boundary(&mesh.tetrahedra).iter().map(|f| SurfaceFace { nodes: f.nodes, skin: true }).collect();
        let mut sides = vec![None; mesh.positions.len()];
        faces.iter().flat_map(|f| f.nodes).for_each(|n| sides[n as usize] = Some(Side::Skin));
        let mut pinned = vec![false; mesh.positions.len()];
        let skin_faces: Vec<[u32; 3]> = faces.iter().map(|f| f.nodes).collect();
        let (mut layer, lost) = PrismLayer::extrude(&inner, &mesh, &skin_faces);
        assert_eq!(lost, 0);
        let n_splits = Refinement {
            inner: &inner,
            mesh: &mut mesh,
            sides: &mut sides,
            pinned: &mut pinned,
            faces: &mut faces,
            layer: &mut layer,
            refused: BTreeSet::new(),
        }
        .run(&Control::new())
        .unwrap();
        let foot = |n: u32| layer.outer_nodes[n as usize].unwrap().point;
        let off = faces.iter().map(|f| stand_off(&inner, &f.nodes.map(foot))).fold(0.0, f64::max);
        (mesh, faces, n_splits, off)
    }

    /// Outer triangles of 4 mm on a ball of 7 mm are off by up to 0.5 mm.
    /// After splitting they follow the ball, and the mesh stays conforming.
    #[test]
    fn curved_skin_gets_finer_tops_that_conform() {
        let (mesh, faces, n_splits, off) = refined(7.0);
        assert!(n_splits > 20, "{n_splits}");
        assert!(off <= TARGET_SKIN_DISTANCE_MM, "{off}");
        let mut kept: Vec<[u32; 3]> = faces.iter().map(|f| sorted(f.nodes)).collect();
        kept.sort_unstable();
        let found: Vec<[u32; 3]> = boundary(&mesh.tetrahedra).iter().map(|f| sorted(f.nodes)).collect();
        assert_eq!(kept, found);
        let volumes = mesh.tetrahedra.iter().map(|t| tetrahedron_volume(&t.map(|i| mesh.positions[i as usize])));
        assert!(volumes.clone().all(|v| v > 0.0));
        // The polyhedron below the prisms is inscribed, so its volume is slightly less than that of the ball of 5.5 mm.
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 5.5f64.powi(3);
        let volume: f64 = volumes.sum();
        assert!(volume < ball && volume > 0.93 * ball, "{volume} {ball}");
    }

    #[test]
    fn flat_skin_is_left_alone() {
        let (_, _, n_splits, off) = refined(30.0);
        assert_eq!(n_splits, 0);
        assert!(off <= TARGET_SKIN_DISTANCE_MM);
    }
}
