//! Supernodal sparse Cholesky factor of the stiffness matrix: one symbolic analysis, numeric factorisations into the same
//! buffers.

use super::assembly::Pattern;
use super::error::SolveError;
use super::precision::Precision;
use super::triangular::{self, Schedule};
use super::tuning::PARALLEL_FROM;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Mat, MatRef, Par, Side};
use std::sync::{Arc, OnceLock};

/// The matrix is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Indefinite;

/// Structure of the factor.
pub(super) struct Symbolic {
    cholesky: SymbolicCholesky<usize>,
    lower: SymbolicSparseColMat<usize>,
    par: Par,
    /// First unknown of the first supernode that contains a node eliminated last.
    corner: usize,
    schedule: Schedule,
}

impl Symbolic {
    /// Symbolic analysis. The pattern's order is the elimination order. The nodes from `first_last` on form the dense corner.
    pub(super) fn new(pattern: &Pattern, first_last: usize) -> Result<Self, SolveError> {
        let n = 3 * pattern.n_columns();
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        // Without a permutation, faer's symbolic analysis reads the upper triangle whatever the side.
        let upper = upper_triangle(pattern);
        let cholesky = factorize_symbolic_cholesky(upper.as_ref(), Side::Upper, SymmetricOrdering::Identity, params)
            .map_err(|e| SolveError::Factorisation { detail: format!("symbolic analysis of {n} unknowns: {e}") })?;
        let par = if n > PARALLEL_FROM { Par::rayon(2) } else { Par::Seq };
        let SymbolicCholeskyRaw::Supernodal(supernodal) = cholesky.raw() else {
            return Err(SolveError::Factorisation { detail: "the factor has no supernodes".to_owned() });
        };
        let begins = supernodal.supernode_begin();
        let corner = match first_last < pattern.n_columns() {
            true => begins.iter().copied().rfind(|&begin| begin <= 3 * first_last).unwrap_or(0),
            false => n,
        };
        let schedule = Schedule::new(supernodal);
        Ok(Self { cholesky, lower: lower_triangle(pattern), par, corner, schedule })
    }

    /// Entries of a factor in single precision, and bytes of scratch memory for its computation.
    pub(super) fn single(&self) -> (usize, usize) {
        let room = self.cholesky.factorize_numeric_llt_scratch::<f32>(self.par, Default::default());
        (self.cholesky.len_val(), room.unaligned_bytes_required())
    }

    /// Number of unknowns in the corner.
    pub(super) fn corner_len(&self) -> usize {
        self.lower.ncols() - self.corner
    }

    fn supernodal(&self) -> Option<&SymbolicSupernodalCholesky<usize>> {
        match self.cholesky.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => Some(symbolic),
            SymbolicCholeskyRaw::Simplicial(_) => None,
        }
    }
}

/// A factor `L Lᵀ`, possibly of an older matrix.
pub(super) struct Factor<T> {
    symbolic: Arc<Symbolic>,
    l_values: Vec<T>,
    memory: MemBuffer,
    valid: bool,
    /// Its dense corner, gathered at first use.
    dense_corner: OnceLock<Mat<T>>,
}

impl<T> std::fmt::Debug for Factor<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut f = f.debug_struct("Factor");
        f.field("entries", &self.l_values.len()).field("valid", &self.valid).finish_non_exhaustive()
    }
}

impl<T: Precision> Factor<T> {
    /// Allocates a factor of this structure.
    pub(super) fn new(symbolic: Arc<Symbolic>) -> Result<Self, SolveError> {
        let need = symbolic.cholesky.factorize_numeric_llt_scratch::<T>(symbolic.par, Default::default());
        let entries = symbolic.cholesky.len_val();
        let failed = || SolveError::Factorisation { detail: format!("no memory for a factor of {entries} entries") };
        let memory = MemBuffer::try_new(need).map_err(|_| failed())?;
        let mut l_values = Vec::new();
        l_values.try_reserve_exact(entries).map_err(|_| failed())?;
        l_values.resize(entries, T::of(0.0));
        Ok(Self { symbolic, l_values, memory, valid: false, dense_corner: OnceLock::new() })
    }

    /// Whether the factor has values to solve with.
    pub(super) fn is_valid(&self) -> bool {
        self.valid
    }

    /// Factorises the matrix with these values (layout: [`Pattern`]).
    pub(super) fn factorise(&mut self, values: &[f64]) -> Result<(), Indefinite> {
        self.valid = false;
        self.dense_corner = OnceLock::new();
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
        // A NaN pivot passes faer's test for positive pivots.
        self.valid = result.is_ok() && self.l_values.last().is_none_or(|v| v.to().is_finite());
        if self.valid { Ok(()) } else { Err(Indefinite) }
    }

    /// Solves in place with the current factor: `L`, then `between` on the unknowns of the corner, then `Lᵀ`.
    pub(super) fn solve(&self, x: &mut [f64], between: impl FnOnce(&mut [f64])) {
        let mut y: Vec<T> = x.iter().map(|v| T::of(*v)).collect();
        let Some((l, schedule)) = self.triangle() else { return };
        triangular::forward(&l, schedule, &mut y);
        let corner = &mut y[self.symbolic.corner..];
        let mut whole: Vec<f64> = corner.iter().map(|v| v.to()).collect();
        between(&mut whole);
        corner.iter_mut().zip(whole).for_each(|(y, v)| *y = T::of(v));
        triangular::backward(&l, schedule, &mut y);
        for (x, y) in x.iter_mut().zip(y) {
            *x = y.to();
        }
    }

    /// `L⁻¹ b`.
    pub(super) fn forward(&self, b: &[f64]) -> Vec<f64> {
        let mut y: Vec<T> = b.iter().map(|v| T::of(*v)).collect();
        if let Some((l, schedule)) = self.triangle() {
            triangular::forward(&l, schedule, &mut y);
        }
        y.iter().map(|v| v.to()).collect()
    }

    /// `L⁻ᵀ y`.
    pub(super) fn backward(&self, y: &[f64]) -> Vec<f64> {
        let mut x: Vec<T> = y.iter().map(|v| T::of(*v)).collect();
        if let Some((l, schedule)) = self.triangle() {
            triangular::backward(&l, schedule, &mut x);
        }
        x.iter().map(|v| v.to()).collect()
    }

    fn triangle(&self) -> Option<(SupernodalLltRef<'_, usize, T>, &Schedule)> {
        let symbolic = self.symbolic.supernodal()?;
        Some((SupernodalLltRef::new(symbolic, &self.l_values), &self.symbolic.schedule))
    }

    /// `L⁻¹` applied to columns that are zero above row `first` of the corner; input and result start at that row.
    pub(super) fn corner_solve(&self, first: usize, columns: Mat<f64>) -> Mat<f64> {
        let mut y = Mat::<T>::from_fn(columns.nrows(), columns.ncols(), |r, c| T::of(columns[(r, c)]));
        let l = self.corner_factor();
        let l = l.submatrix(first, first, l.nrows() - first, l.ncols() - first);
        solve_lower_triangular_in_place(l, y.as_mut(), self.symbolic.par);
        Mat::from_fn(y.nrows(), y.ncols(), |r, c| y[(r, c)].to())
    }

    /// The rows of `L⁻ᵀ y` in the corner, in place.
    pub(super) fn corner_transpose_solve(&self, y: &mut [f64]) {
        let mut column = Mat::<T>::from_fn(y.len(), 1, |r, _| T::of(y[r]));
        solve_upper_triangular_in_place(self.corner_factor().transpose(), column.as_mut(), Par::Seq);
        y.iter_mut().enumerate().for_each(|(r, y)| *y = column[(r, 0)].to());
    }

    /// The dense corner of the factor.
    fn corner_factor(&self) -> MatRef<'_, T> {
        self.dense_corner.get_or_init(|| self.gathered_corner().unwrap_or_else(Mat::new)).as_ref()
    }

    fn gathered_corner(&self) -> Option<Mat<T>> {
        let corner = self.symbolic.corner;
        let (l, _) = self.triangle()?;
        let n = self.corner().len();
        let mut dense = Mat::<T>::zeros(n, n);
        let in_corner = |s: &usize| l.symbolic().supernode_begin()[*s] >= corner;
        for s in (0..l.symbolic().n_supernodes()).filter(in_corner) {
            let node = l.supernode(s);
            let (begin, value) = (node.start() - corner, node.val());
            let width = value.ncols();
            for c in 0..width {
                for r in c..width {
                    dense[(begin + r, begin + c)] = value[(r, c)];
                }
                for (place, &row) in node.pattern().iter().enumerate() {
                    dense[(row - corner, begin + c)] = value[(width + place, c)];
                }
            }
        }
        Some(dense)
    }

    /// Range of the unknowns in the corner.
    pub(super) fn corner(&self) -> std::ops::Range<usize> {
        self.symbolic.corner..self.symbolic.lower.ncols()
    }
}

/// Scalar compressed columns whose values have the layout of the pattern; diagonal blocks are stored whole.
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
