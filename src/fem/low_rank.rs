//! What contact adds to a factor without making it anew.

use super::contact::RankOne;
use crate::geometry::Vector;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::sync::Arc;

/// Vectors that differ by less than this share of their length count as the same: the correction serves a preconditioner.
const ALIKE: f64 = 0.05;

/// `(I + G D Gᵀ)⁻¹` with `G = L⁻¹ V`, where `V` and `D` are the vectors and factors of rank-one terms that a factor `L Lᵀ` does not
/// know of: between the two triangular solves it makes the factor one of the matrix with the terms.
///
/// By the Woodbury identity it is `I - G (D⁻¹ + Gᵀ G)⁻¹ Gᵀ`.
#[derive(Debug)]
pub(super) struct LowRank {
    /// Terms with their columns of `G`, unknowns of the corner.
    columns: Vec<(RankOne, Arc<Vec<f64>>)>,
    core: Cholesky<f64, Dyn>,
}

impl LowRank {
    /// `corner` are the unknowns that the terms act on, `solve` applies `L⁻¹` to columns there. Columns of `known`, of the same factor and
    /// like vectors, are taken over. `None` when there are no terms, when one acts on other unknowns, or when the factor is too coarse for them.
    pub(super) fn new(
        terms: &[RankOne],
        known: Option<Self>,
        corner: std::ops::Range<usize>,
        solve: impl FnOnce(Mat<f64>) -> Mat<f64>,
    ) -> Option<Self> {
        if terms.is_empty() {
            return None;
        }
        let known = known.map(|k| k.columns).unwrap_or_default();
        let found: Vec<Option<Arc<Vec<f64>>>> = (terms.iter())
            .map(|term| known.iter().find(|(t, _)| is_close(t, term)).map(|(_, column)| Arc::clone(column)))
            .collect();
        let unknown: Vec<&RankOne> = terms.iter().zip(&found).filter(|(_, f)| f.is_none()).map(|(t, _)| t).collect();
        let mut v = Mat::<f64>::zeros(corner.len(), unknown.len());
        for (column, term) in unknown.iter().enumerate() {
            for (node, entry) in &term.nodes {
                let first = (3 * *node as usize).checked_sub(corner.start)?;
                for i in 0..3 {
                    v[(first + i, column)] += entry[i];
                }
            }
        }
        let solved = if unknown.is_empty() { v } else { solve(v) };
        let mut new = (0..solved.ncols()).map(|c| Arc::new(solved.col_as_slice(c).to_vec()));
        let columns = terms.iter().zip(found).map(|(term, f)| Some((term.clone(), f.or_else(|| new.next())?)));
        let columns: Vec<(RankOne, Arc<Vec<f64>>)> = columns.collect::<Option<_>>()?;
        let m = terms.len();
        let g = Mat::<f64>::from_fn(corner.len(), m, |r, c| columns[c].1[r]);
        let mut product = Mat::<f64>::zeros(m, m);
        matmul(product.as_mut(), Accum::Replace, g.transpose(), g.as_ref(), 1.0, Par::Seq);
        let mut core = DMatrix::from_fn(m, m, |r, c| product[(r, c)]);
        for (i, term) in terms.iter().enumerate() {
            core[(i, i)] += 1.0 / term.factor;
        }
        Some(Self { columns, core: core.cholesky()? })
    }

    /// Adds `Σ columns[i] loads[i]` to the corner's unknowns.
    pub(super) fn add_loads(&self, loads: &[f64], y: &mut [f64]) {
        for ((_, g), load) in self.columns.iter().zip(loads) {
            y.iter_mut().zip(g.iter()).for_each(|(y, g)| *y += g * load);
        }
    }

    /// Applies it to the corner's unknowns.
    pub(super) fn apply(&self, y: &mut [f64]) {
        let along = self.columns.iter().map(|(_, g)| vector_dot(g, y));
        let mut rhs = DVector::from_iterator(self.columns.len(), along);
        self.core.solve_mut(&mut rhs);
        rhs.neg_mut();
        self.add_loads(rhs.as_slice(), y);
    }
}

/// Whether the vectors of two terms are alike.
fn is_close(a: &RankOne, b: &RankOne) -> bool {
    let alike = |((m, v), (n, w)): (&(u32, Vector), &(u32, Vector))| m == n && (v - w).norm() <= ALIKE * w.norm();
    a.nodes.len() == b.nodes.len() && a.nodes.iter().zip(&b.nodes).all(alike)
}

/// Sum in a fixed order that the processor's vectors can follow.
fn vector_dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum::<f64>() + super::linear_solve::dot(a_rest, b_rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With `L = 2 I` the matrix with the terms is `4 I + V D Vᵀ`.
    #[test]
    fn a_corrected_factor_is_the_inverse_of_the_matrix_with_the_terms() {
        let term = |nodes: Vec<(u32, Vector)>, factor| RankOne { nodes, factor };
        let terms = [
            term(vec![(1, Vector::new(1.0, 2.0, 0.0)), (2, Vector::new(0.0, -1.0, 0.5))], 7.0),
            term(vec![(2, Vector::new(0.3, 0.0, 1.0))], 100.0),
        ];
        let low_rank = LowRank::new(&terms, None, 3..9, |v| &v * faer::Scale(0.5)).unwrap();
        let mut matrix = DMatrix::identity(6, 6) * 4.0;
        for t in &terms {
            let mut v = DVector::zeros(6);
            for (node, entry) in &t.nodes {
                v.fixed_rows_mut::<3>(3 * *node as usize - 3).copy_from(entry);
            }
            matrix += &v * v.transpose() * t.factor;
        }
        let b = DVector::from_fn(6, |i, _| i as f64 - 2.2);
        let mut y: Vec<f64> = b.iter().map(|b| 0.5 * b).collect();
        low_rank.apply(&mut y);
        let x = DVector::from_iterator(6, y.iter().map(|y| 0.5 * y));
        assert!((matrix * x - &b).norm() < 1e-12 * b.norm());
        assert!(LowRank::new(&terms, None, 6..9, |v| v).is_none(), "node 1 is outside of the corner");
        assert!(LowRank::new(&[], None, 3..9, |v| v).is_none());
    }
}
