//! The Woodbury identity by nodes, for more terms than nodes have unknowns.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::factor::{lu_in_place, lu_in_place_scratch};
use faer::linalg::lu::partial_pivoting::solve::{solve_in_place, solve_in_place_scratch};
use faer::perm::PermRef;
use faer::{Mat, Par};
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
use std::collections::BTreeMap;

/// Rank-one terms by offsets and entries, and their factors.
pub(super) type PlacedTerms<'a> = (&'a [Vec<(usize, Vector)>], &'a [f64]);

/// Reaction `-K (I + S K)⁻¹ u` of terms with the stiffness `K = V D Vᵀ` at nodes with the compliance `S`.
#[derive(Debug)]
pub(super) struct NodeCore {
    /// Offsets of the nodes, ascending.
    places: Vec<usize>,
    /// Blocks of `K` by indices of the nodes.
    stiffness: Vec<(usize, usize, Matrix3<f64>)>,
    /// Factors of `I + S K` with unit lower triangle, and their row permutation.
    lu: Mat<f64>,
    forward: Vec<usize>,
    inverse: Vec<usize>,
}

impl NodeCore {
    /// `compliance` gives blocks of `S` by two offsets. `None` when the matrix is singular.
    pub(super) fn new(
        (terms, factors): PlacedTerms<'_>,
        compliance: impl Fn(usize, usize) -> Matrix3<f64>,
    ) -> Option<Self> {
        let mut places: Vec<usize> = terms.iter().flatten().map(|(place, _)| *place).collect();
        places.sort_unstable();
        places.dedup();
        let index = |place: &usize| places.binary_search(place).ok();
        let mut blocks: BTreeMap<(usize, usize), Matrix3<f64>> = BTreeMap::new();
        for (term, factor) in terms.iter().zip(factors) {
            for (b, vb) in term {
                for (a, va) in term {
                    *blocks.entry((index(b)?, index(a)?)).or_default() += va * vb.transpose() * *factor;
                }
            }
        }
        // By column, then row.
        let stiffness: Vec<(usize, usize, Matrix3<f64>)> = blocks.into_iter().map(|((c, r), k)| (r, c, k)).collect();
        let n = 3 * places.len();
        let mut lu = Mat::<f64>::identity(n, n);
        for (inner, column, k) in &stiffness {
            for (row, place) in places.iter().enumerate() {
                let product = compliance(*place, places[*inner]) * k;
                for c in 0..3 {
                    for r in 0..3 {
                        lu[(3 * row + r, 3 * column + c)] += product[(r, c)];
                    }
                }
            }
        }
        let (mut forward, mut inverse) = (vec![0; n], vec![0; n]);
        let mut memory = MemBuffer::new(lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Default::default()));
        let stack = MemStack::new(&mut memory);
        lu_in_place(lu.as_mut(), &mut forward, &mut inverse, Par::Seq, stack, Default::default());
        let is_regular = (0..n).all(|i| lu[(i, i)].is_normal());
        is_regular.then_some(Self { places, stiffness, lu, forward, inverse })
    }

    /// Adds the reaction to the displacements `u` to the forces `f`.
    pub(super) fn add_reaction(&self, u: &[f64], f: &mut [f64]) {
        let n = self.lu.nrows();
        let mut w = Mat::from_fn(n, 1, |i, _| u[self.places[i / 3] + i % 3]);
        let mut memory = MemBuffer::new(solve_in_place_scratch::<usize, f64>(n, 1, Par::Seq));
        let rows = PermRef::new_checked(&self.forward, &self.inverse, n);
        solve_in_place(self.lu.as_ref(), self.lu.as_ref(), rows, w.as_mut(), Par::Seq, MemStack::new(&mut memory));
        for (row, column, k) in &self.stiffness {
            let force = k * Vector::new(w[(3 * column, 0)], w[(3 * column + 1, 0)], w[(3 * column + 2, 0)]);
            (0..3).for_each(|i| f[self.places[*row] + i] -= force[i]);
        }
    }
}
