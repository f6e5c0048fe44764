//! A contact point paired with a body or with a triangle of tissue.

use super::turning::Turning;
use crate::fem::tuning::DEPTH_BETWEEN_POINTS;
use nalgebra::Matrix3;
use prosopon_geometry::Vector;

/// A contact point and a body, by their indices.
///
/// Points of tissue that faces tissue come after those that face bone; their body is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::fem) struct PairIndex {
    pub(in crate::fem) point: usize,
    pub(in crate::fem) body: usize,
}

/// What a contact point touches.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) enum Target {
    /// A body, by its index.
    Body(usize),
    /// The nearest face, edge or corner of a triangle of tissue: its one to three nodes.
    Tissue { nodes: [u32; 3], n_nodes: usize },
}

/// Nodes that a gap depends on. The gap's gradient by a node is the node's weight times the normal.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Terms {
    nodes: [u32; 6],
    weights: [f64; 6],
    len: usize,
}

impl Terms {
    /// Adds `weight` to that of `node`; a node beyond the sixth is left out, as two triangles have no more.
    pub(super) fn add(&mut self, node: u32, weight: f64) {
        match self.nodes[..self.len].iter().position(|n| *n == node) {
            Some(known) => self.weights[known] += weight,
            None if self.len < 6 => {
                (self.nodes[self.len], self.weights[self.len]) = (node, weight);
                self.len += 1;
            }
            None => {}
        }
    }

    /// Nodes and their weights.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, f64)> {
        let Self { nodes, weights, len } = *self;
        (0..len).map(move |i| (nodes[i], weights[i]))
    }
}

impl FromIterator<(u32, f64)> for Terms {
    fn from_iter<T: IntoIterator<Item = (u32, f64)>>(pairs: T) -> Self {
        let mut terms = Self::default();
        pairs.into_iter().for_each(|(node, weight)| terms.add(node, weight));
        terms
    }
}

/// A contact point paired with a body or a triangle that it touches or is near to.
#[derive(Debug, Clone, Copy)]
pub(in crate::fem) struct ContactPair {
    pub(super) index: PairIndex,
    pub(super) target: Target,
    /// Signed gap, mm, after subtraction of the overlap at rest.
    pub(super) gap: f64,
    /// Gradient of the gap with respect to the point.
    pub(super) normal: Vector,
    /// Share of the surface area at rest, mm².
    pub(super) area: f64,
    /// Stiffness, MPa/mm.
    pub(super) stiffness: f64,
    /// `p - k g`, MPa; the contact is active where this is positive.
    pub(super) pressure: f64,
    /// Pressure at the state of linearisation, MPa.
    pub(super) linearised_pressure: f64,
    pub(super) terms: Terms,
}

/// Second derivative of a gap times its pressure and area, N/mm. It is subtracted from the Hessian of the contact energy.
pub(super) enum CurvatureTerm {
    /// With respect to the point; the blocks of two nodes differ by their weights.
    OfPoint(Matrix3<f64>),
    /// The triangle turns with its nodes.
    Turning(Turning),
}

impl CurvatureTerm {
    /// Block of two nodes with these weights.
    pub(super) fn block(&self, (a, wa): (u32, f64), (b, wb): (u32, f64)) -> Matrix3<f64> {
        match self {
            Self::OfPoint(block) => block * (wa * wb),
            Self::Turning(turning) => turning.block((a, wa), (b, wb)),
        }
    }
}

impl ContactPair {
    /// Indices of contact point and body.
    pub(in crate::fem) fn index(&self) -> PairIndex {
        self.index
    }

    /// Signed gap, mm.
    pub(in crate::fem) fn gap(&self) -> f64 {
        self.gap
    }

    /// Factor on the gap before it is compared with the tolerance.
    pub(in crate::fem) fn share_of_tolerance(&self) -> f64 {
        match self.target {
            Target::Body(_) => 1.0,
            Target::Tissue { .. } => DEPTH_BETWEEN_POINTS,
        }
    }

    /// Whether the contact is active.
    pub(in crate::fem) fn is_active(&self) -> bool {
        self.pressure > 0.0
    }

    /// Gauss-Newton part of the Hessian with respect to the point, N/mm.
    pub(super) fn gauss_newton(&self) -> Matrix3<f64> {
        self.normal * self.normal.transpose() * (self.stiffness * self.area)
    }
}
