use super::adjacency::{BoundaryFace, Rows};
use super::domain::{InnerTissue, Side};
use super::lattice::STEPS;
use super::quality::smallest_sine;
use super::stuffing::TetMesh;
use super::tuning::{GOOD_SINE, SMOOTHING_STEPS};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector};

/// Nodes, the surfaces that constrain them, and the tetrahedra around them.
pub(super) struct Relaxation<'a, 'd> {
    pub(super) inner: &'a InnerTissue<'d>,
    pub(super) mesh: &'a mut TetMesh,
    /// Surface of each boundary node; `None` inside.
    pub(super) sides: &'a [Option<Side>],
    /// Nodes that must never move.
    pub(super) pinned: &'a [bool],
    /// Nodes that averaging leaves in place.
    held: Vec<bool>,
    around: Rows,
    neighbours: Rows,
}

impl<'a, 'd> Relaxation<'a, 'd> {
    /// Nodes where different surfaces meet are kept in place.
    pub(super) fn new(
        inner: &'a InnerTissue<'d>,
        mesh: &'a mut TetMesh,
        sides: &'a [Option<Side>],
        pinned: &'a [bool],
        faces: &[BoundaryFace],
    ) -> Self {
        let n = mesh.positions.len();
        let around = Rows::incidence(n, &mesh.tetrahedra);
        let mut held = pinned.to_vec();
        let mut edges: Vec<(u32, u32)> = Vec::new();
        for face in faces {
            for i in 0..3 {
                let (a, b) = (face.nodes[i], face.nodes[(i + 1) % 3]);
                if sides[a as usize] == sides[b as usize] {
                    edges.extend([(a, b), (b, a)]);
                } else {
                    held[a as usize] = true;
                    held[b as usize] = true;
                }
            }
        }
        for t in &mesh.tetrahedra {
            for i in 0..4 {
                for j in (0..4).filter(|j| *j != i) {
                    if sides[t[i] as usize].is_none() {
                        edges.push((t[i], t[j]));
                    }
                }
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let neighbours = Rows::of(n, edges.iter().copied());
        Self { inner, mesh, sides, pinned, held, around, neighbours }
    }

    /// Smallest sine around `node` if it were at `p`; stops early below `enough`.
    fn worst_around(&self, node: usize, p: &Point, enough: f64) -> f64 {
        let mut worst = f64::INFINITY;
        for &t in self.around.row(node) {
            let nodes = self.mesh.tetrahedra[t as usize];
            let corners = nodes.map(|i| if i as usize == node { *p } else { self.mesh.positions[i as usize] });
            worst = worst.min(smallest_sine(&corners));
            if worst < enough {
                return worst;
            }
        }
        worst
    }

    /// `p` projected onto the surface that constrains `node`.
    fn held_to_surface(&self, node: usize, p: Point) -> Option<Point> {
        match self.sides[node] {
            None => Some(p),
            Some(side) => self.inner.project(side, &p, 0.5 * self.inner.edge),
        }
    }

    /// Moves every node towards the mean of its neighbours, on its own surface.
    /// A move is accepted when no tetrahedron becomes worse than the worst one around the node or than `GOOD_SINE`.
    pub(super) fn towards_neighbours(&mut self, rounds: usize, control: &Control) -> Result<(), Cancelled> {
        for _ in 0..rounds {
            control.check()?;
            for node in 0..self.mesh.positions.len() {
                let neighbours = self.neighbours.row(node);
                if self.held[node] || neighbours.is_empty() || self.around.row(node).is_empty() {
                    continue;
                }
                let here = self.mesh.positions[node];
                let sum = neighbours.iter().fold(Vector::zeros(), |s, &n| s + self.mesh.positions[n as usize].coords);
                let mean = Point::from(sum / neighbours.len() as f64);
                let limit = self.worst_around(node, &here, f64::NEG_INFINITY).min(GOOD_SINE);
                for share in [1.0, 0.5] {
                    let Some(p) = self.held_to_surface(node, here + (mean - here) * share) else { continue };
                    if self.worst_around(node, &p, limit) >= limit {
                        self.mesh.positions[node] = p;
                        break;
                    }
                }
            }
        }
        Ok(())
    }

    /// Pattern search on the nodes of bad tetrahedra: accepts steps that improve the worst tetrahedron around a node.
    pub(super) fn improve(&mut self, rounds: usize, control: &Control) -> Result<(), Cancelled> {
        let edge = self.inner.edge;
        for _ in 0..rounds {
            control.check()?;
            let mut wanted = vec![false; self.mesh.positions.len()];
            let mut any = false;
            for t in &self.mesh.tetrahedra {
                if smallest_sine(&t.map(|i| self.mesh.positions[i as usize])) < GOOD_SINE {
                    any = true;
                    for &i in t {
                        wanted[i as usize] = true;
                    }
                }
            }
            if !any {
                break;
            }
            for node in (0..wanted.len()).filter(|&n| wanted[n] && !self.pinned[n]) {
                for length in SMOOTHING_STEPS {
                    self.search(node, length * edge);
                }
            }
        }
        Ok(())
    }

    fn search(&mut self, node: usize, length: f64) {
        let here = self.mesh.positions[node];
        let mut best = (self.worst_around(node, &here, f64::NEG_INFINITY), here);
        if best.0 >= GOOD_SINE {
            return;
        }
        for step in STEPS {
            let direction = Vector::from(step.map(f64::from)).normalize();
            let Some(p) = self.held_to_surface(node, here + direction * length) else { continue };
            let worst = self.worst_around(node, &p, best.0);
            if worst > best.0 + 1e-4 {
                best = (worst, p);
            }
        }
        self.mesh.positions[node] = best.1;
    }
}
