//! Triangular solves with a supernodal factor: subtrees of the elimination tree in parallel, then the supernodes above them.
//!
//! The tasks depend on the factor's structure only, and their contributions to the columns above are added in task order: the
//! bits are the same at any number of threads.
//!
//! On 53 000 unknowns with 39 million entries it takes 0.7 of the time of faer's solve
//! (`SLOW_TESTS=1 cargo test times_of_both_solves -- --nocapture`).

use super::precision::Precision;
use super::tuning::{LARGEST_SUBTREE, SHARED_ROWS};
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Columns that are eliminated together.
const BLOCK: usize = 4;
/// Partial sums of a dot product, for SIMD registers.
const LANES: usize = 16;

/// Number of threads that share the work of one supernode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Threads {
    One,
    /// Two, when it has at least [`SHARED_ROWS`] rows below.
    Two,
}

/// Division of a triangular solve into tasks.
#[derive(Debug, Clone)]
pub(super) struct Schedule {
    /// Supernodes of each subtree, in the order of columns.
    subtrees: Vec<Range<usize>>,
    /// Supernodes above all subtrees, ascending.
    top: Vec<usize>,
}

impl Schedule {
    pub(super) fn new(symbolic: &SymbolicSupernodalCholesky<usize>) -> Self {
        let n = symbolic.n_supernodes();
        let weight: Vec<f64> = (0..n)
            .map(|s| {
                let width = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
                (width * (width + symbolic.supernode(s).pattern().len())) as f64
            })
            .collect();
        let parent = |s: usize| {
            let row = symbolic.supernode(s).pattern().first()?;
            Some(symbolic.supernode_begin().partition_point(|begin| begin <= row) - 1)
        };
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); n];
        let mut roots = Vec::new();
        for s in 0..n {
            match parent(s) {
                Some(p) => children[p].push(s),
                None => roots.push(s),
            }
        }
        // First supernode and weight of each subtree. Only a contiguous subtree, as a postorder makes it, can be a task.
        let (mut first, mut total, mut count) = ((0..n).collect::<Vec<_>>(), weight, vec![1usize; n]);
        for s in 0..n {
            for &c in &children[s] {
                first[s] = first[s].min(first[c]);
                total[s] += total[c];
                count[s] += count[c];
            }
        }
        let limit = LARGEST_SUBTREE * roots.iter().map(|&r| total[r]).sum::<f64>();
        let (mut subtrees, mut top) = (Vec::new(), Vec::new());
        let mut open = roots;
        while let Some(s) = open.pop() {
            if total[s] <= limit && count[s] == s + 1 - first[s] {
                subtrees.push(first[s]..s + 1);
            } else {
                top.push(s);
                open.extend(&children[s]);
            }
        }
        subtrees.sort_unstable_by_key(|r| r.start);
        top.sort_unstable();
        Self { subtrees, top }
    }
}

/// For each subtree: its supernodes, its first column, and its part of `x`; the parts are disjoint and ascending.
fn subtree_tasks<'x, T: Precision>(
    l: &SupernodalLltRef<'_, usize, T>,
    schedule: &Schedule,
    x: &'x mut [T],
) -> Vec<(Range<usize>, usize, &'x mut [T])> {
    let (begin, end) = (l.symbolic().supernode_begin(), l.symbolic().supernode_end());
    let (mut rest, mut at) = (x, 0);
    let mut tasks = Vec::with_capacity(schedule.subtrees.len());
    for nodes in &schedule.subtrees {
        let (from, to) = (begin[nodes.start], end[nodes.end - 1]);
        let (mine, tail) = rest.split_at_mut(to - at);
        rest = tail;
        tasks.push((nodes.clone(), from, &mut mine[from - at..]));
        at = to;
    }
    tasks
}

/// Solves `L x = b` in place.
pub(super) fn forward<T: Precision>(l: &SupernodalLltRef<'_, usize, T>, schedule: &Schedule, x: &mut [T]) {
    let n = x.len();
    let left: Vec<Vec<(usize, T)>> = subtree_tasks(l, schedule, x)
        .into_par_iter()
        .with_max_len(1)
        .map(|(nodes, from, mine)| {
            let to = from + mine.len();
            let mut above = vec![T::of(0.0); n - to];
            let mut work = Vec::new();
            let mut touched = Vec::new();
            for s in nodes {
                let node = l.supernode(s);
                let start = node.start() - from;
                eliminate(l, s, &mut mine[start..], &mut work, Threads::One);
                for (&row, &w) in node.pattern().iter().zip(&work) {
                    if row < to {
                        mine[row - from] += w;
                    } else {
                        if above[row - to] == T::of(0.0) {
                            touched.push(row);
                        }
                        above[row - to] += w;
                    }
                }
            }
            touched.sort_unstable();
            touched.dedup();
            touched.into_iter().map(|row| (row, above[row - to])).collect()
        })
        .collect();
    for (row, w) in left.into_iter().flatten() {
        x[row] += w;
    }
    let mut work = Vec::new();
    for &s in &schedule.top {
        let node = l.supernode(s);
        eliminate(l, s, &mut x[node.start()..], &mut work, Threads::Two);
        for (&row, &w) in node.pattern().iter().zip(&work) {
            x[row] += w;
        }
    }
}

/// Solves `Lᵀ x = b` in place.
pub(super) fn backward<T: Precision>(l: &SupernodalLltRef<'_, usize, T>, schedule: &Schedule, x: &mut [T]) {
    let mut work = Vec::new();
    for &s in schedule.top.iter().rev() {
        let node = l.supernode(s);
        work.clear();
        work.extend(node.pattern().iter().map(|&row| x[row]));
        substitute(l, s, &mut x[node.start()..], &work);
    }
    let above: Vec<T> = x.to_vec();
    subtree_tasks(l, schedule, x).into_par_iter().with_max_len(1).for_each(|(nodes, from, mine)| {
        let to = from + mine.len();
        let mut work = Vec::new();
        for s in nodes.rev() {
            let node = l.supernode(s);
            work.clear();
            work.extend(node.pattern().iter().map(|&row| if row < to { mine[row - from] } else { above[row] }));
            substitute(l, s, &mut mine[node.start() - from..], &work);
        }
    });
}

/// Columns of a supernode: `width` columns of `rows` values each, with the diagonal block on top.
#[derive(Clone, Copy)]
struct Panel<'a, T> {
    values: &'a [T],
    width: usize,
    rows: usize,
}

impl<'a, T: Precision> Panel<'a, T> {
    fn of(l: &SupernodalLltRef<'a, usize, T>, s: usize) -> Self {
        let symbolic = l.symbolic();
        let width = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
        let rows = width + symbolic.supernode(s).pattern().len();
        let first = symbolic.col_ptr_for_val()[s];
        Self { values: &l.values()[first..first + width * rows], width, rows }
    }

    #[inline(always)]
    fn column(&self, j: usize) -> &'a [T] {
        &self.values[j * self.rows..(j + 1) * self.rows]
    }
}

/// Solves with the diagonal block of supernode `s` in `x`, which starts at its first column; `below` receives the update of the
/// rows below.
fn eliminate<T: Precision>(
    l: &SupernodalLltRef<'_, usize, T>,
    s: usize,
    x: &mut [T],
    below: &mut Vec<T>,
    threads: Threads,
) {
    let panel = Panel::of(l, s);
    let x = &mut x[..panel.width];
    below.clear();
    below.resize(panel.rows - panel.width, T::of(0.0));
    let arch = pulp::Arch::new();
    arch.dispatch(Diagonal { panel, x });
    if threads == Threads::Two && below.len() >= SHARED_ROWS {
        let half = below.len() / 2;
        let (a, b) = below.split_at_mut(half);
        rayon::join(
            || arch.dispatch(Below { panel, first: panel.width, x, out: a }),
            || arch.dispatch(Below { panel, first: panel.width + half, x, out: b }),
        );
    } else {
        arch.dispatch(Below { panel, first: panel.width, x, out: below });
    }
}

/// Solves with the transposed diagonal block of supernode `s` in `x`, which starts at its first column; `below` holds the solved
/// rows below.
fn substitute<T: Precision>(l: &SupernodalLltRef<'_, usize, T>, s: usize, x: &mut [T], below: &[T]) {
    let panel = Panel::of(l, s);
    pulp::Arch::new().dispatch(Transposed { panel, x: &mut x[..panel.width], below });
}

/// Solves with the diagonal block, in place in `x`.
struct Diagonal<'a, T> {
    panel: Panel<'a, T>,
    x: &'a mut [T],
}

impl<T: Precision> WithSimd for Diagonal<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { panel, x } = self;
        for from in (0..panel.width).step_by(BLOCK) {
            let to = panel.width.min(from + BLOCK);
            for j in from..to {
                let l = panel.column(j);
                let xj = x[j] / l[j];
                x[j] = xj;
                for r in j + 1..to {
                    x[r] -= l[r] * xj;
                }
            }
            let (solved, rest) = x.split_at_mut(to);
            subtract(&panel, from..to, to, solved, rest);
        }
    }
}

/// Subtracts the rows from `first` on, times `x`, from `out`.
struct Below<'a, T> {
    panel: Panel<'a, T>,
    first: usize,
    x: &'a [T],
    out: &'a mut [T],
}

impl<T: Precision> WithSimd for Below<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for from in (0..self.panel.width).step_by(BLOCK) {
            let to = self.panel.width.min(from + BLOCK);
            subtract(&self.panel, from..to, self.first, self.x, self.out);
        }
    }
}

/// `out -= Σ l_j x_j` over at most [`BLOCK`] columns, rows from `first` on.
#[inline(always)]
fn subtract<T: Precision>(panel: &Panel<'_, T>, columns: Range<usize>, first: usize, x: &[T], out: &mut [T]) {
    let rows = first..first + out.len();
    if columns.len() == BLOCK {
        let [a, b, c, d] = std::array::from_fn(|i| &panel.column(columns.start + i)[rows.clone()]);
        let [fa, fb, fc, fd] = std::array::from_fn(|i| x[columns.start + i]);
        for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *out -= *a * fa + *b * fb + *c * fc + *d * fd;
        }
    } else {
        for j in columns {
            let factor = x[j];
            for (out, l) in out.iter_mut().zip(&panel.column(j)[rows.clone()]) {
                *out -= *l * factor;
            }
        }
    }
}

/// Solves with the transposed diagonal block in place in `x`, after subtraction of `below`.
struct Transposed<'a, T> {
    panel: Panel<'a, T>,
    x: &'a mut [T],
    below: &'a [T],
}

impl<T: Precision> WithSimd for Transposed<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { panel, x, below } = self;
        for j in (0..panel.width).rev() {
            let l = panel.column(j);
            let (top, bottom) = l.split_at(panel.width);
            let sum = dot(bottom, below) + dot(&top[j + 1..], &x[j + 1..]);
            x[j] = (x[j] - sum) / l[j];
        }
    }
}

#[inline(always)]
fn dot<T: Precision>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::of(0.0); LANES];
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            sums[i] += a[i] * b[i];
        }
    }
    let mut sum = T::of(0.0);
    for (a, b) in a_rest.iter().zip(b_rest) {
        sum += *a * *b;
    }
    sums.iter().fold(sum, |s, v| s + *v)
}

#[cfg(test)]
mod tests;
