//! Blocks of the stiffness outside the elements' sparsity pattern: tissue that touches tissue couples nodes of no common element.

use nalgebra::Matrix3;
use prosopon_geometry::Vector;

/// A symmetric matrix of few blocks, stored below the diagonal.
#[derive(Debug, Clone, Default)]
pub(super) struct Coupling {
    /// Row, column (`row > column`, unknown nodes) and block.
    blocks: Vec<(u32, u32, Matrix3<f64>)>,
}

impl Coupling {
    /// Removes all blocks.
    pub(super) fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Adds a block; `row > column`.
    pub(super) fn add(&mut self, row: u32, column: u32, block: Matrix3<f64>) {
        self.blocks.push((row, column, block));
    }

    /// Sums the blocks of each pair of nodes, in the order in which they were added.
    pub(super) fn merge(&mut self) {
        self.blocks.sort_by_key(|(row, column, _)| (*row, *column));
        self.blocks.dedup_by(|next, kept| {
            let is_same = (next.0, next.1) == (kept.0, kept.1);
            if is_same {
                kept.2 += next.2;
            }
            is_same
        });
    }

    /// Adds the product with `x` to `y`.
    pub(super) fn add_product(&self, x: &[f64], y: &mut [f64]) {
        for (row, column, block) in &self.blocks {
            let (r, c) = (3 * *row as usize, 3 * *column as usize);
            let below = block * Vector::new(x[c], x[c + 1], x[c + 2]);
            let above = block.tr_mul(&Vector::new(x[r], x[r + 1], x[r + 2]));
            for i in 0..3 {
                y[r + i] += below[i];
                y[c + i] += above[i];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn the_product_is_that_of_the_symmetric_matrix() {
        let block = |k: f64| Matrix3::from_fn(|r, c| k + (3 * r + c) as f64);
        let mut coupling = Coupling::default();
        let mut dense = DMatrix::zeros(9, 9);
        for (row, column, k) in [(2, 0, 1.0), (1, 0, 0.5), (2, 0, -3.0)] {
            coupling.add(row, column, block(k));
            let (r, c) = (3 * row as usize, 3 * column as usize);
            let (mut below, t) = (dense.fixed_view_mut::<3, 3>(r, c), block(k));
            below += t;
            let mut above = dense.fixed_view_mut::<3, 3>(c, r);
            above += t.transpose();
        }
        coupling.merge();
        assert_eq!(coupling.blocks.len(), 2);
        let x = DVector::from_fn(9, |i, _| (i as f64).sin());
        let mut y = vec![0.0; 9];
        coupling.add_product(x.as_slice(), &mut y);
        assert!((DVector::from_vec(y) - dense * x).norm() < 1e-12);
    }
}
