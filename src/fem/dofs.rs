//! Which generalised nodes are unknown, which follow bone, and how unknowns are numbered.

use super::element::{C1Surface, ElementBlock};
use super::error::SolveError;
use super::ordering;
use crate::geometry::{Motion, Point, Vector};
use crate::mesh::{Attachment, MixedMesh};

/// What decides the value of a generalised node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hold {
    /// Equilibrium does.
    Free,
    /// It moves with a bone segment.
    Segment(u32),
    /// It stays at rest: a far boundary, or a node of no element.
    Still,
}

/// Marks a generalised node that is not unknown.
const HELD: u32 = u32::MAX;

/// Numbering of the unknown generalised nodes, in elimination order; each carries three unknowns.
#[derive(Debug, Clone)]
pub(super) struct Dofs {
    hold: Vec<Hold>,
    unknown: Vec<u32>,
    node_of: Vec<u32>,
    rest: Vec<Vector>,
    n_mesh_nodes: usize,
}

impl Dofs {
    /// Classifies and numbers the generalised nodes. `surface` is there when the skin is made of C1 prisms.
    pub(super) fn new(
        mesh: &MixedMesh,
        surface: Option<&C1Surface>,
        blocks: &[ElementBlock],
    ) -> Result<Self, SolveError> {
        let n_mesh_nodes = mesh.positions.len();
        let mut rest: Vec<Vector> = mesh.positions.iter().map(|p| p.coords).collect();
        let mut hold: Vec<Hold> = mesh
            .attachment
            .iter()
            .map(|a| match *a {
                Attachment::Free | Attachment::Sliding => Hold::Free,
                Attachment::Tied(segment) => Hold::Segment(segment),
                Attachment::Fixed => Hold::Still,
            })
            .collect();
        // A tangent vector goes with the node it belongs to, so the rim of a region is clamped.
        let mut owner: Vec<u32> = (0..n_mesh_nodes as u32).collect();
        if let Some(surface) = surface {
            for (&node, tangents) in surface.outer_nodes.iter().zip(&surface.rest_tangents) {
                for tangent in tangents {
                    rest.push(*tangent);
                    hold.push(hold[node as usize]);
                    owner.push(node);
                }
            }
        }
        let mut used = vec![false; rest.len()];
        for block in blocks {
            for &node in &block.nodes {
                used[node as usize] = true;
            }
        }
        for (hold, used) in hold.iter_mut().zip(&used) {
            if !used {
                *hold = Hold::Still;
            }
        }
        check_support(mesh, blocks, &hold, n_mesh_nodes)?;

        let free: Vec<bool> = hold.iter().map(|h| *h == Hold::Free).collect();
        let node_of = ordering::elimination_order(blocks, &free, &owner)?;
        let mut unknown = vec![HELD; rest.len()];
        for (index, &node) in node_of.iter().enumerate() {
            unknown[node as usize] = index as u32;
        }
        Ok(Self { hold, unknown, node_of, rest, n_mesh_nodes })
    }

    /// Number of generalised nodes.
    pub(super) fn n_nodes(&self) -> usize {
        self.rest.len()
    }

    /// Number of unknown generalised nodes (three unknowns each).
    pub(super) fn n_unknown(&self) -> usize {
        self.node_of.len()
    }

    /// Index of `node` among the unknown ones.
    pub(super) fn unknown(&self, node: u32) -> Option<u32> {
        let index = self.unknown[node as usize];
        (index != HELD).then_some(index)
    }

    /// Generalised node of each unknown one.
    pub(super) fn nodes(&self) -> &[u32] {
        &self.node_of
    }

    /// Rest values of all generalised nodes.
    pub(super) fn rest(&self) -> &[Vector] {
        &self.rest
    }

    /// What holds each generalised node.
    pub(super) fn holds(&self) -> &[Hold] {
        &self.hold
    }

    /// Whether `node` is a position rather than a tangent vector.
    pub(super) fn is_position(&self, node: usize) -> bool {
        node < self.n_mesh_nodes
    }

    /// Writes the held values under `motion` (of a segment, from rest) into `x`.
    pub(super) fn prescribe(&self, motion: impl Fn(u32) -> Motion, x: &mut [Vector]) {
        for (node, hold) in self.hold.iter().enumerate() {
            match *hold {
                Hold::Free => {}
                Hold::Still => x[node] = self.rest[node],
                Hold::Segment(segment) => {
                    let m = motion(segment);
                    x[node] = if self.is_position(node) {
                        (m * Point::from(self.rest[node])).coords
                    } else {
                        m.rotation * self.rest[node]
                    };
                }
            }
        }
    }

    /// Adds `scale` times the unknowns `d` to `x`.
    pub(super) fn add(&self, scale: f64, d: &[f64], x: &mut [Vector]) {
        for (node, d) in self.node_of.iter().zip(d.chunks_exact(3)) {
            x[*node as usize] += Vector::new(d[0], d[1], d[2]) * scale;
        }
    }

    /// The entries of the unknowns out of one vector for each generalised node.
    pub(super) fn restrict(&self, values: &[Vector], out: &mut [f64]) {
        for (node, out) in self.node_of.iter().zip(out.chunks_exact_mut(3)) {
            out.copy_from_slice(values[*node as usize].as_slice());
        }
    }

    /// Largest length of the position unknowns in `d`, mm.
    pub(super) fn max_position_change(&self, d: &[f64]) -> f64 {
        let positions = self.node_of.iter().zip(d.chunks_exact(3)).filter(|(n, _)| self.is_position(**n as usize));
        positions.map(|(_, d)| Vector::new(d[0], d[1], d[2]).norm()).fold(0.0, f64::max)
    }
}

/// Every connected part needs three held nodes that are not on one line, else it can move freely.
fn check_support(
    mesh: &MixedMesh,
    blocks: &[ElementBlock],
    hold: &[Hold],
    n_mesh_nodes: usize,
) -> Result<(), SolveError> {
    let mut parent: Vec<u32> = (0..n_mesh_nodes as u32).collect();
    let mut used = vec![false; n_mesh_nodes];
    for block in blocks {
        for nodes in block.nodes.chunks_exact(block.n_functions) {
            let mut positions = nodes.iter().copied().filter(|&n| (n as usize) < n_mesh_nodes);
            let Some(first) = positions.next() else { continue };
            used[first as usize] = true;
            for node in positions {
                used[node as usize] = true;
                let (a, b) = (root(&mut parent, first), root(&mut parent, node));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    let mut parts: Vec<(u32, u32)> =
        (0..n_mesh_nodes as u32).filter(|&n| used[n as usize]).map(|n| (root(&mut parent, n), n)).collect();
    parts.sort_unstable();
    if parts.is_empty() {
        return Err(SolveError::Problem { detail: "the mesh has no elements".into() });
    }
    for part in parts.chunk_by(|a, b| a.0 == b.0) {
        let held: Vec<Point> = part
            .iter()
            .filter(|(_, n)| hold[*n as usize] != Hold::Free)
            .map(|(_, n)| mesh.positions[*n as usize])
            .collect();
        if !spans_a_plane(&held) {
            let p = mesh.positions[part[0].1 as usize];
            let detail = format!(
                "the part of {} nodes near ({:.1}, {:.1}, {:.1}) mm has {} tied or fixed nodes; it needs three that are not on one line",
                part.len(),
                p.x,
                p.y,
                p.z,
                held.len()
            );
            return Err(SolveError::Problem { detail });
        }
    }
    Ok(())
}

fn root(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        parent[node as usize] = parent[parent[node as usize] as usize];
        node = parent[node as usize];
    }
    node
}

fn spans_a_plane(points: &[Point]) -> bool {
    let Some(first) = points.first() else { return false };
    let far = points.iter().map(|p| p - first).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let Some(axis) = far.and_then(|d| d.try_normalize(0.0)) else { return false };
    let length = far.map_or(0.0, |d| d.norm());
    points.iter().any(|p| {
        let d = p - first;
        (d - axis * axis.dot(&d)).norm() > 1e-6 * length
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_line_do_not_hold_a_body() {
        let line: Vec<Point> = (0..4).map(|i| Point::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
        assert!(!spans_a_plane(&line));
        assert!(!spans_a_plane(&[]));
        assert!(spans_a_plane(&[line[0], line[1], Point::new(0.0, 0.0, 1.0)]));
    }
}
