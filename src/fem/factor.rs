//! Supernodal sparse Cholesky factor of the stiffness matrix: symbolic once, numeric into kept buffers.

use super::assembly::Pattern;
use super::error::SolveError;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::traits::RealField;
use faer::{Conj, MatMut, Par, Side};
use std::sync::Arc;

/// Unknowns above which faer splits its dense work in two. The split is fixed, so the bits do not depend on the number of threads.
const PARALLEL_FROM: usize = 3000;

/// The matrix is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Indefinite;

/// Structure of the factor.
pub(super) struct Symbolic {
    cholesky: SymbolicCholesky<usize>,
    lower: SymbolicSparseColMat<usize>,
    par: Par,
}

impl Symbolic {
    /// Symbolic analysis. The pattern's order is the elimination order.
    pub(super) fn new(pattern: &Pattern) -> Result<Self, SolveError> {
        let n = 3 * pattern.n_columns();
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        // Without a permutation faer's symbolic analysis reads the upper triangle whatever the side.
        let upper = upper_triangle(pattern);
        let cholesky = factorize_symbolic_cholesky(upper.as_ref(), Side::Upper, SymmetricOrdering::Identity, params)
            .map_err(|e| SolveError::Factorisation { detail: format!("symbolic analysis of {n} unknowns: {e}") })?;
        let par = if n > PARALLEL_FROM { Par::rayon(2) } else { Par::Seq };
        Ok(Self { cholesky, lower: lower_triangle(pattern), par })
    }
}

/// Number type of a factor.
pub(super) trait Precision: RealField + Copy {
    fn of(value: f64) -> Self;
    fn to(self) -> f64;
}

impl Precision for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn to(self) -> f64 {
        f64::from(self)
    }
}

impl Precision for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn to(self) -> f64 {
        self
    }
}

/// A factor `L Lᵀ`, possibly of an older matrix.
pub(super) struct Factor<T> {
    symbolic: Arc<Symbolic>,
    l_values: Vec<T>,
    memory: MemBuffer,
    valid: bool,
}

impl<T> std::fmt::Debug for Factor<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut f = f.debug_struct("Factor");
        f.field("entries", &self.l_values.len()).field("valid", &self.valid).finish_non_exhaustive()
    }
}

impl<T: Precision> Factor<T> {
    /// Room for a factor of this structure.
    pub(super) fn new(symbolic: Arc<Symbolic>) -> Result<Self, SolveError> {
        let need = StackReq::any_of(&[
            symbolic.cholesky.factorize_numeric_llt_scratch::<T>(symbolic.par, Default::default()),
            symbolic.cholesky.solve_in_place_scratch::<T>(1, Par::Seq),
        ]);
        let entries = symbolic.cholesky.len_val();
        let failed = || SolveError::Factorisation { detail: format!("no memory for a factor of {entries} entries") };
        let memory = MemBuffer::try_new(need).map_err(|_| failed())?;
        let mut l_values = Vec::new();
        l_values.try_reserve_exact(entries).map_err(|_| failed())?;
        l_values.resize(entries, T::of(0.0));
        Ok(Self { symbolic, l_values, memory, valid: false })
    }

    /// Whether there is a factor to solve with.
    pub(super) fn is_valid(&self) -> bool {
        self.valid
    }

    /// Factorises the matrix with these values (laid out as [`Pattern`] says).
    pub(super) fn factorise(&mut self, values: &[f64]) -> Result<(), Indefinite> {
        self.valid = false;
        let values: Vec<T> = values.iter().map(|v| T::of(*v)).collect();
        let matrix = SparseColMatRef::new(self.symbolic.lower.as_ref(), values.as_slice());
        let result = self.symbolic.cholesky.factorize_numeric_llt(
            &mut self.l_values,
            matrix,
            Side::Lower,
            Default::default(),
            self.symbolic.par,
            MemStack::new(&mut self.memory),
            Default::default(),
        );
        // A pivot that is not a number passes faer's test for positive ones.
        self.valid = result.is_ok() && self.l_values.last().is_none_or(|v| v.to().is_finite());
        if self.valid { Ok(()) } else { Err(Indefinite) }
    }

    /// Solves in place with the present factor.
    pub(super) fn solve(&mut self, x: &mut [f64]) {
        let mut y: Vec<T> = x.iter().map(|v| T::of(*v)).collect();
        LltRef::new(&self.symbolic.cholesky, &self.l_values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut y, x.len(), 1),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
        for (x, y) in x.iter_mut().zip(y) {
            *x = y.to();
        }
    }
}

/// Scalar compressed columns whose values are laid out as those of the pattern; diagonal blocks are whole.
fn lower_triangle(pattern: &Pattern) -> SymbolicSparseColMat<usize> {
    let n = 3 * pattern.n_columns();
    let mut start = Vec::with_capacity(n + 1);
    let mut rows = Vec::with_capacity(pattern.n_values());
    start.push(0);
    for column in 0..pattern.n_columns() {
        for _ in 0..3 {
            rows.extend(pattern.rows(column).iter().flat_map(|&r| (0..3).map(move |i| 3 * r as usize + i)));
            start.push(rows.len());
        }
    }
    SymbolicSparseColMat::new_checked(n, n, start, None, rows)
}

fn upper_triangle(pattern: &Pattern) -> SymbolicSparseColMat<usize> {
    let blocks = pattern.n_columns();
    let mut above: Vec<Vec<u32>> = vec![Vec::new(); blocks];
    for column in 0..blocks {
        for &row in &pattern.rows(column)[1..] {
            above[row as usize].push(column as u32);
        }
    }
    let mut start = vec![0];
    let mut rows = Vec::with_capacity(pattern.n_values());
    for (column, above) in above.iter().enumerate() {
        for c in 0..3 {
            rows.extend(above.iter().flat_map(|&r| (0..3).map(move |i| 3 * r as usize + i)));
            rows.extend((0..=c).map(|i| 3 * column + i));
            start.push(rows.len());
        }
    }
    SymbolicSparseColMat::new_checked(3 * blocks, 3 * blocks, start, None, rows)
}
