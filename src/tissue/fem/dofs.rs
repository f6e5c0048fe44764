//! Classification of the generalised nodes (unknown, tied to bone or fixed) and numbering of the unknowns.

use super::axes::{ALL_AXES, axes_in};
use super::element::{C1Surface, ElementBlock};
use super::error::SolveError;
use super::ordering;
use super::settings::Boundary;
use super::support::check_support;
use super::tuning::ALIGNED;
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Motion, Point, Vector};

/// Condition on the value of a generalised node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Condition {
    /// Unknown, found by equilibrium.
    Free,
    /// Moves with a bone segment.
    Segment(u32),
    /// Stays at rest, except along axes with a prescribed displacement: at a cut boundary, or a node of no element.
    Fixed,
}

/// Marks a generalised node that is not unknown.
const HELD: u32 = u32::MAX;

/// Numbering of the unknown generalised nodes, in elimination order; each carries three unknowns.
#[derive(Debug, Clone)]
pub(super) struct Dofs {
    conditions: Vec<Condition>,
    unknown: Vec<u32>,
    node_of: Vec<u32>,
    rest: Vec<Vector>,
    n_mesh_nodes: usize,
    /// Held axes, by generalised node; empty when there are none.
    axes: Vec<u8>,
    /// Displacement along held axes at path parameter 1, by mesh node, mm; empty when all stay at rest.
    prescribed: Vec<Vector>,
    /// Unknown nodes with held axes.
    partly_held: Vec<PartlyHeld>,
    /// Tangent vectors of partly held nodes that are oblique to the axis and therefore stay free.
    oblique_tangents: usize,
    /// First of the unknown nodes that are eliminated last.
    first_last: usize,
    /// Whether an unknown node is a corner of the outer skin.
    visible: Vec<bool>,
}

/// An unknown node that is held along some axes, and these axes (bits).
#[derive(Debug, Clone, Copy)]
pub(super) struct PartlyHeld {
    pub(super) unknown: u32,
    pub(super) axes: u8,
}

/// Conditions on all generalised nodes.
struct Conditions {
    conditions: Vec<Condition>,
    rest: Vec<Vector>,
    axes: Vec<u8>,
    /// Mesh node that each generalised node belongs to.
    owner: Vec<u32>,
    oblique_tangents: usize,
}

impl Conditions {
    fn new(mesh: &MixedMesh, boundary: &Boundary, surface: Option<&C1Surface>) -> Self {
        let mut conditions: Vec<Condition> = mesh
            .attachment
            .iter()
            .map(|a| match *a {
                Attachment::Free | Attachment::Sliding | Attachment::Gliding(_) => Condition::Free,
                Attachment::Tied(segment) => Condition::Segment(segment),
                Attachment::Fixed => Condition::Fixed,
            })
            .collect();
        let attached = conditions.clone();
        for (condition, axes) in conditions.iter_mut().zip(&boundary.held_axes) {
            if *axes == ALL_AXES {
                *condition = Condition::Fixed;
            }
        }
        let mut found = Self {
            conditions,
            rest: mesh.positions.iter().map(|p| p.coords).collect(),
            axes: boundary.held_axes.clone(),
            owner: (0..mesh.positions.len() as u32).collect(),
            oblique_tangents: 0,
        };
        if let Some(surface) = surface {
            found.add_tangents(surface, boundary, &attached);
        }
        found
    }

    /// Adds the tangent vectors of a surface to the conditions of the mesh nodes, which are `attached` to bone.
    ///
    /// A tangent vector has the condition of its node, so the rim of a region is clamped. Where three planes of symmetry meet,
    /// only the node is fixed: its tangents stay in the planes.
    fn add_tangents(&mut self, surface: &C1Surface, boundary: &Boundary, attached: &[Condition]) {
        for (&node, tangents) in surface.outer_nodes.iter().zip(&surface.rest_tangents) {
            for tangent in tangents {
                self.rest.push(*tangent);
                self.conditions.push(attached[node as usize]);
                self.owner.push(node);
                if let Some(&held) = boundary.held_axes.get(node as usize) {
                    let of_tangent = axes_of_tangent(held, tangent);
                    let is_free = attached[node as usize] == Condition::Free;
                    self.oblique_tangents += usize::from(of_tangent.is_oblique && is_free);
                    self.axes.push(of_tangent.axes);
                }
            }
        }
    }

    /// Fixes the nodes of no element.
    fn fix_unused(&mut self, blocks: &[&ElementBlock]) {
        let mut used = vec![false; self.rest.len()];
        for block in blocks {
            for &node in &block.nodes {
                used[node as usize] = true;
            }
        }
        for (condition, used) in self.conditions.iter_mut().zip(&used) {
            if !used {
                *condition = Condition::Fixed;
            }
        }
    }
}

impl Dofs {
    /// Classifies and numbers the generalised nodes. `surface` is present when the skin consists of C1 prisms. Mesh nodes flagged
    /// in `last` get the last numbers.
    pub(super) fn new(
        mesh: &MixedMesh,
        boundary: &Boundary,
        surface: Option<&C1Surface>,
        blocks: &[&ElementBlock],
        last: &[bool],
    ) -> Result<Self, SolveError> {
        let mut found = Conditions::new(mesh, boundary, surface);
        found.fix_unused(blocks);
        let Conditions { conditions, rest, axes, owner, oblique_tangents } = found;
        check_support(mesh, boundary)?;

        let free: Vec<bool> = conditions.iter().map(|h| *h == Condition::Free).collect();
        let node_of = ordering::elimination_order(blocks, &free, &owner, last)?;
        let mut outer = vec![false; rest.len()];
        mesh.prisms.iter().flat_map(|p| &p[..3]).for_each(|&node| outer[node as usize] = true);
        let visible = node_of.iter().map(|&node| outer[node as usize]).collect();
        let is_last = |node: &u32| last.get(*node as usize).copied().unwrap_or(false);
        let first_last = node_of.iter().position(is_last).unwrap_or(node_of.len());
        let mut unknown = vec![HELD; rest.len()];
        for (index, &node) in node_of.iter().enumerate() {
            unknown[node as usize] = index as u32;
        }
        let partly_held = (axes.iter().zip(&unknown))
            .filter(|(axes, unknown)| **axes != 0 && **unknown != HELD)
            .map(|(&axes, &unknown)| PartlyHeld { unknown, axes })
            .collect();
        Ok(Self {
            conditions,
            unknown,
            node_of,
            rest,
            n_mesh_nodes: mesh.positions.len(),
            axes,
            prescribed: boundary.prescribed_mm.clone(),
            partly_held,
            oblique_tangents,
            first_last,
            visible,
        })
    }

    /// Number of generalised nodes.
    pub(super) fn n_nodes(&self) -> usize {
        self.rest.len()
    }

    /// Whether a generalised node stays at rest along the whole path: it is fixed and has no prescribed displacement.
    pub(super) fn stays_at_rest(&self, node: usize) -> bool {
        self.conditions[node] == Condition::Fixed && self.prescribed.get(node).is_none_or(|u| *u == Vector::zeros())
    }

    /// Number of unknown generalised nodes (three unknowns each).
    pub(super) fn n_unknown(&self) -> usize {
        self.node_of.len()
    }

    /// First of the unknown nodes that are eliminated last; [`Dofs::n_unknown`] when there are none.
    pub(super) fn first_last(&self) -> usize {
        self.first_last
    }

    /// Number of scalar unknowns, without those along held axes.
    pub(super) fn n_scalar(&self) -> usize {
        let held: u32 = self.partly_held.iter().map(|held| held.axes.count_ones()).sum();
        3 * self.node_of.len() - held as usize
    }

    /// Unknown nodes that are held along some axes.
    pub(super) fn partly_held(&self) -> &[PartlyHeld] {
        &self.partly_held
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

    /// Condition on each generalised node.
    pub(super) fn conditions(&self) -> &[Condition] {
        &self.conditions
    }

    /// Whether `node` is a position rather than a tangent vector.
    pub(super) fn is_position(&self, node: usize) -> bool {
        node < self.n_mesh_nodes
    }

    /// Writes the held values into `x`: `motion` of each segment from rest, and `share` of the prescribed displacements.
    pub(super) fn prescribe(&self, motion: impl Fn(u32) -> Motion, share: f64, x: &mut [Vector]) {
        for (node, condition) in self.conditions.iter().enumerate() {
            match *condition {
                Condition::Free => {
                    if let Some(along) = self.prescribed.get(node) {
                        for axis in axes_in(self.axes_of(node)) {
                            x[node][axis] = self.rest[node][axis] + share * along[axis];
                        }
                    }
                }
                Condition::Fixed => {
                    x[node] = self.rest[node] + self.prescribed.get(node).map_or_else(Vector::zeros, |u| u * share);
                }
                Condition::Segment(segment) => {
                    let m = motion(segment);
                    x[node] = if self.is_position(node) {
                        (m * Point::from(self.rest[node])).coords
                    } else {
                        m.rotation * self.rest[node]
                    };
                    for axis in axes_in(self.axes_of(node)) {
                        x[node][axis] =
                            self.rest[node][axis] + self.prescribed.get(node).map_or(0.0, |u| share * u[axis]);
                    }
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

    /// Extracts the entries of the unknowns from one vector for each generalised node; entries along held axes are 0.
    pub(super) fn restrict(&self, values: &[Vector], out: &mut [f64]) {
        for (node, out) in self.node_of.iter().zip(out.chunks_exact_mut(3)) {
            out.copy_from_slice(values[*node as usize].as_slice());
        }
        for &PartlyHeld { unknown, axes } in &self.partly_held {
            for axis in axes_in(axes) {
                out[3 * unknown as usize + axis] = 0.0;
            }
        }
    }

    /// Axes (bits) along which a node is held in addition to its other condition.
    pub(super) fn axes_of(&self, node: usize) -> u8 {
        self.axes.get(node).copied().unwrap_or(0)
    }

    /// Number of tied nodes that `motion` would move by more than `tolerance` mm along an axis in which they are held.
    pub(super) fn contradictions(&self, motion: impl Fn(u32) -> Motion, tolerance: f64) -> usize {
        let torn = |node: usize, segment: u32| {
            let change = motion(segment) * Point::from(self.rest[node]) - Point::from(self.rest[node]);
            axes_in(self.axes_of(node)).any(|axis| change[axis].abs() > tolerance)
        };
        (0..self.n_mesh_nodes).filter(|&n| matches!(self.conditions[n], Condition::Segment(s) if torn(n, s))).count()
    }

    /// Number of tangent vectors that a plane of symmetry should hold but that are oblique to it.
    pub(super) fn oblique_tangents(&self) -> usize {
        self.oblique_tangents
    }

    /// Largest change of a position on the outer skin in `d`, mm; of all positions when there is no skin.
    pub(super) fn max_visible_change(&self, d: &[f64]) -> f64 {
        if !self.visible.contains(&true) {
            return self.max_position_change(d);
        }
        let of_skin = d.chunks_exact(3).zip(&self.visible).filter(|(_, visible)| **visible);
        of_skin.map(|(d, _)| Vector::new(d[0], d[1], d[2]).norm()).fold(0.0, f64::max)
    }

    /// Largest change of a position in `d`, mm.
    pub(super) fn max_position_change(&self, d: &[f64]) -> f64 {
        let positions = self.node_of.iter().zip(d.chunks_exact(3)).filter(|(n, _)| self.is_position(**n as usize));
        positions.map(|(_, d)| Vector::new(d[0], d[1], d[2]).norm()).fold(0.0, f64::max)
    }
}

/// Axes along which a tangent vector is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TangentAxes {
    axes: u8,
    /// Whether the tangent is oblique to an axis along which its node is held.
    is_oblique: bool,
}

/// Axes of a tangent vector that stay at rest when its node is held along `held`.
///
/// A node held along an axis in the surface lies on a plane of symmetry: the tangent across the plane stays across it, the
/// tangent along the plane stays in it. Frames of a surface at right angles to a coordinate plane have such tangents. Other
/// tangents are oblique and stay free.
fn axes_of_tangent(held: u8, tangent: &Vector) -> TangentAxes {
    let direction = tangent.normalize();
    let is_oblique = axes_in(held).any(|a| (ALIGNED..=1.0 - ALIGNED).contains(&direction[a].abs()));
    let across =
        axes_in(held).filter(|&a| direction[a].abs() > 1.0 - ALIGNED).fold(0, |bits, a| bits | (ALL_AXES & !(1 << a)));
    let along = axes_in(held).filter(|&a| direction[a].abs() < ALIGNED).fold(0, |bits, a| bits | 1 << a);
    TangentAxes { axes: across | along, is_oblique }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_on_a_plane_of_symmetry_stay_symmetric() {
        let check = |held: u8, tangent: Vector, axes: u8, is_oblique: bool| {
            assert_eq!(axes_of_tangent(held, &tangent), TangentAxes { axes, is_oblique });
        };
        check(1, Vector::new(0.8, 0.0, 0.0), 0b110, false);
        check(1, Vector::new(0.0, 0.6, 0.8), 0b001, false);
        check(1, Vector::new(0.6, 0.8, 0.0), 0, true);
        check(5, Vector::new(0.6, 0.8, 0.0), 0b100, true);
        check(3, Vector::x(), 0b110, false);
    }
}
