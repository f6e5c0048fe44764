use nalgebra::Matrix3;

use crate::mesh::Tissue;
use prosopon_geometry::Vector;

/// Reason why elements could not be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ElementError {
    /// The rest configuration is inverted at a quadrature point.
    #[error("{kind} {element} is inverted at rest: det {det:.3e}")]
    InvertedAtRest {
        /// Kind of element.
        kind: &'static str,
        /// Index of the cell in the mesh.
        element: usize,
        /// Jacobian determinant at that point.
        det: f64,
    },
}

/// A cell of a [`MixedMesh`](crate::mesh::MixedMesh).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshCell {
    /// A tetrahedron, by index.
    Tetrahedron(u32),
    /// A prism, by index.
    Prism(u32),
}

/// Elements of one kind, with shape function gradients at rest.
///
/// Each element has `n` functions and `q` points. For element `e`, point `p` and function `a`:
/// generalised node `nodes[e*n + a]`, gradient `gradients[(e*q + p)*n + a]` = dN_a/dX (1/mm), weight `weights[e*q + p]` (mm³).
/// The deformation gradient is `F = Σ_a x_a ⊗ gradients_a`, where `x_a` is the generalised node's current 3-vector.
#[derive(Debug, Clone, PartialEq)]
pub struct ElementBlock {
    /// Kind, for messages: `tetrahedron`, `wedge`, `prism`.
    pub kind: &'static str,
    /// Functions of each element: 4, 6 or 12, or one of [`SMOOTHED_WIDTHS`](super::SMOOTHED_WIDTHS).
    pub n_functions: usize,
    /// Quadrature points of each element.
    pub n_points: usize,
    /// Generalised node of each function of each element.
    pub nodes: Vec<u32>,
    /// dN/dX, 1/mm.
    pub gradients: Vec<Vector>,
    /// Quadrature weight times the rest Jacobian, mm³.
    pub weights: Vec<f64>,
    /// Tissue of each element.
    pub tissue: Vec<Tissue>,
    /// Cell of the mesh that each element is, or is part of.
    pub cells: Vec<MeshCell>,
}

impl ElementBlock {
    /// Number of elements.
    #[must_use]
    pub fn n_elements(&self) -> usize {
        self.tissue.len()
    }

    /// Keeps the elements for whose generalised nodes `wanted` returns true.
    pub(in crate::fem) fn retain(&mut self, wanted: impl Fn(&[u32]) -> bool) {
        let keep: Vec<bool> = self.nodes.chunks_exact(self.n_functions).map(wanted).collect();
        if keep.iter().all(|k| *k) {
            return;
        }
        fn kept<T: Clone>(values: &mut Vec<T>, keep: &[bool]) {
            let each = values.len() / keep.len();
            *values = (values.chunks(each).zip(keep)).filter(|(_, k)| **k).flat_map(|(v, _)| v.to_vec()).collect();
        }
        kept(&mut self.nodes, &keep);
        kept(&mut self.gradients, &keep);
        kept(&mut self.weights, &keep);
        kept(&mut self.tissue, &keep);
        kept(&mut self.cells, &keep);
    }

    pub(super) fn empty(kind: &'static str, n_functions: usize, n_points: usize, n_elements: usize) -> Self {
        Self {
            kind,
            n_functions,
            n_points,
            nodes: Vec::with_capacity(n_elements * n_functions),
            gradients: Vec::with_capacity(n_elements * n_points * n_functions),
            weights: Vec::with_capacity(n_elements * n_points),
            tissue: Vec::with_capacity(n_elements),
            cells: Vec::with_capacity(n_elements),
        }
    }

    /// Appends one quadrature point of element `element`: `rest[a]` is generalised node `a` at rest, `derivatives[a]` the
    /// derivative of function `a` by the reference coordinates, which must be right-handed.
    pub(super) fn push_point(
        &mut self,
        element: usize,
        reference_weight: f64,
        rest: &[Vector],
        derivatives: &[Vector],
    ) -> Result<(), ElementError> {
        let jacobian: Matrix3<f64> = rest.iter().zip(derivatives).map(|(x, d)| x * d.transpose()).sum();
        let det = jacobian.determinant();
        let inverse = jacobian.try_inverse().filter(|_| det > 0.0 && det.is_finite());
        let Some(inverse) = inverse else {
            return Err(ElementError::InvertedAtRest { kind: self.kind, element, det });
        };
        self.weights.push(reference_weight * det);
        self.gradients.extend(derivatives.iter().map(|d| inverse.tr_mul(d)));
        Ok(())
    }
}
