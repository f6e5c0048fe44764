//! Sparsity pattern of the stiffness matrix, and the position of each element's blocks in it.

use super::kernel::n_slots;
use crate::fem::dofs::{Dofs, PartlyHeld};
use crate::fem::element::ElementBlock;
use nalgebra::Matrix3;
use prosopon_geometry::Vector;
use rayon::prelude::*;

/// Lower triangle of a symmetric matrix of 3×3 blocks, by block columns; each column starts with its diagonal block.
///
/// Values are laid out as scalar compressed columns: entry `(r, c)` of block `p` of column `j` is at
/// `9 start[j] + 3 n c + 3 (p - start[j]) + r`, with `n` blocks in the column. Diagonal blocks are stored whole.
#[derive(Debug, Clone)]
pub(in crate::fem) struct Pattern {
    start: Vec<usize>,
    rows: Vec<u32>,
}

impl Pattern {
    /// Number of block columns.
    pub(in crate::fem) fn n_columns(&self) -> usize {
        self.start.len() - 1
    }

    /// Number of stored values.
    pub(in crate::fem) fn n_values(&self) -> usize {
        9 * self.rows.len()
    }

    /// Block rows of column `column`, ascending, the diagonal first.
    pub(in crate::fem) fn rows(&self, column: usize) -> &[u32] {
        &self.rows[self.start[column]..self.start[column + 1]]
    }

    /// Number of blocks.
    pub(super) fn n_blocks(&self) -> usize {
        self.rows.len()
    }

    /// First block of column `column`.
    pub(super) fn block_start(&self, column: usize) -> usize {
        self.start[column]
    }

    /// First value of column `column`.
    pub(in crate::fem) fn value_start(&self, column: usize) -> usize {
        9 * self.start[column]
    }

    /// Whether the block, `row >= column`, is in the pattern.
    pub(in crate::fem) fn contains(&self, row: u32, column: u32) -> bool {
        self.rows(column as usize).binary_search(&row).is_ok()
    }

    /// Adds a block to `values`; `row >= column`, and the block must be in the pattern.
    pub(in crate::fem) fn add(&self, row: u32, column: u32, block: &Matrix3<f64>, values: &mut [f64]) {
        let rows = self.rows(column as usize);
        let Ok(place) = rows.binary_search(&row) else {
            debug_assert!(false, "block ({row}, {column}) is not in the pattern");
            return;
        };
        let values = &mut values[self.value_start(column as usize)..];
        for c in 0..3 {
            for r in 0..3 {
                values[3 * rows.len() * c + 3 * place + r] += block[(r, c)];
            }
        }
    }

    /// Removes unknowns from the system: sets rows and columns of the axes (bits) of these unknown nodes to zero, except the
    /// diagonal.
    pub(in crate::fem) fn hold(&self, held: &[PartlyHeld], values: &mut [f64]) {
        if held.is_empty() {
            return;
        }
        let mut axes = vec![0u8; self.n_columns()];
        for held in held {
            axes[held.unknown as usize] = held.axes;
        }
        for column in 0..self.n_columns() {
            let rows = self.rows(column);
            let values = &mut values[self.value_start(column)..self.value_start(column) + 9 * rows.len()];
            for (place, &row) in rows.iter().enumerate() {
                let (of_row, of_column) = (axes[row as usize], axes[column]);
                if of_row | of_column == 0 {
                    continue;
                }
                for c in 0..3 {
                    for r in 0..3 {
                        let diagonal = row as usize == column && r == c;
                        if !diagonal && (of_row >> r | of_column >> c) & 1 == 1 {
                            values[3 * rows.len() * c + 3 * place + r] = 0.0;
                        }
                    }
                }
            }
        }
    }

    /// The diagonal block of column `column`.
    pub(in crate::fem) fn diagonal(&self, column: usize, values: &[f64]) -> Matrix3<f64> {
        let (begin, stride) = (self.value_start(column), 3 * self.rows(column).len());
        Matrix3::from_fn(|r, c| values[begin + stride * c + r])
    }

    /// Inverses of the diagonal blocks; `None` when one is not positive definite.
    pub(in crate::fem) fn inverse_diagonal(&self, values: &[f64]) -> Option<Vec<Matrix3<f64>>> {
        let block = |column: usize| self.diagonal(column, values).cholesky().map(|factor| factor.inverse());
        (0..self.n_columns()).map(block).collect()
    }

    /// `y = A x`, always computed in two halves, so that the bits do not depend on the number of threads.
    pub(in crate::fem) fn multiply(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        let middle = self.start.partition_point(|&start| 2 * start < self.n_blocks()).min(self.n_columns());
        let mut second = vec![0.0; y.len()];
        y.fill(0.0);
        rayon::join(
            || self.add_product(0..middle, values, x, y),
            || self.add_product(middle..self.n_columns(), values, x, &mut second),
        );
        y[3 * middle..].iter_mut().zip(&second[3 * middle..]).for_each(|(y, s)| *y += s);
    }

    /// Adds the contribution of the blocks of these columns, and of their transposes, to `A x`. It affects rows from the first
    /// column on.
    fn add_product(&self, columns: std::ops::Range<usize>, values: &[f64], x: &[f64], y: &mut [f64]) {
        for column in columns {
            let rows = self.rows(column);
            let values = &values[self.value_start(column)..self.value_start(column) + 9 * rows.len()];
            let xj = Vector::new(x[3 * column], x[3 * column + 1], x[3 * column + 2]);
            let mut yj = Vector::zeros();
            for (place, &row) in rows.iter().enumerate() {
                let at = |r: usize, c: usize| values[3 * rows.len() * c + 3 * place + r];
                let row = row as usize;
                for r in 0..3 {
                    y[3 * row + r] += at(r, 0) * xj.x + at(r, 1) * xj.y + at(r, 2) * xj.z;
                }
                if row != column {
                    for c in 0..3 {
                        yj[c] += at(0, c) * x[3 * row] + at(1, c) * x[3 * row + 1] + at(2, c) * x[3 * row + 2];
                    }
                }
            }
            for c in 0..3 {
                y[3 * column + c] += yj[c];
            }
        }
    }
}

/// Code of a slot that is not added anywhere.
pub(super) const NOWHERE: u32 = u32::MAX;

/// For each slot of the element matrices, twice the index of its block in the pattern, plus one if the slot is added transposed.
///
/// Slots are numbered through all element blocks, their elements, and the local pairs `(a, b)` with `a >= b`.
#[derive(Debug, Clone)]
pub(super) struct Slots {
    codes: Vec<u32>,
}

impl Slots {
    pub(super) fn codes(&self, slots: std::ops::Range<usize>) -> &[u32] {
        &self.codes[slots]
    }
}

/// Pairs `(row, column, transposed)` of unknowns that an element couples, in the order of its slots; `None` for slots of held
/// nodes and of padding (the first node, repeated).
fn pairs<'a>(nodes: &'a [u32], dofs: &'a Dofs) -> impl Iterator<Item = Option<(u32, u32, bool)>> + 'a {
    let unknown = |i: usize| if i > 0 && nodes[i] == nodes[0] { None } else { dofs.unknown(nodes[i]) };
    (0..nodes.len()).flat_map(move |a| (0..=a).map(move |b| (a, b))).map(move |(a, b)| {
        let (ua, ub) = (unknown(a)?, unknown(b)?);
        Some((ua.max(ub), ua.min(ub), ua < ub))
    })
}

/// Builds the pattern and the codes of the slots.
pub(super) fn build(blocks: &[&ElementBlock], dofs: &Dofs) -> (Pattern, Slots) {
    let elements = || blocks.iter().flat_map(|b| b.nodes.chunks_exact(b.n_functions));
    let mut begin = vec![0usize; dofs.n_unknown() + 1];
    for (_, column, _) in elements().flat_map(|nodes| pairs(nodes, dofs)).flatten() {
        begin[column as usize + 1] += 1;
    }
    for column in 0..dofs.n_unknown() {
        begin[column + 1] += begin[column];
    }
    let mut next = begin.clone();
    let mut coupled = vec![0u32; begin[dofs.n_unknown()]];
    for (row, column, _) in elements().flat_map(|nodes| pairs(nodes, dofs)).flatten() {
        coupled[next[column as usize]] = row;
        next[column as usize] += 1;
    }
    let (mut start, mut rows) = (vec![0usize], Vec::new());
    for column in 0..dofs.n_unknown() {
        let mine = &mut coupled[begin[column]..begin[column + 1]];
        mine.sort_unstable();
        rows.extend(mine.chunk_by(|a, b| a == b).map(|same| same[0]));
        start.push(rows.len());
    }
    drop(coupled);
    let pattern = Pattern { start, rows };
    let mut codes = vec![NOWHERE; total_slots(blocks)];
    let mut rest = codes.as_mut_slice();
    for block in blocks {
        let slots = n_slots(block.n_functions);
        let (mine, tail) = rest.split_at_mut(block.n_elements() * slots);
        rest = tail;
        mine.par_chunks_exact_mut(slots).zip(block.nodes.par_chunks_exact(block.n_functions)).for_each(
            |(codes, nodes)| {
                for (code, pair) in codes.iter_mut().zip(pairs(nodes, dofs)) {
                    let place = pair.and_then(|(row, column, transposed)| {
                        let place = pattern.rows(column as usize).binary_search(&row).ok()?;
                        Some(2 * (pattern.start[column as usize] + place) as u32 + u32::from(transposed))
                    });
                    *code = place.unwrap_or(NOWHERE);
                }
            },
        );
    }
    (pattern, Slots { codes })
}

/// Total number of slots.
pub(in crate::fem) fn total_slots(blocks: &[&ElementBlock]) -> usize {
    blocks.iter().map(|b| b.n_elements() * n_slots(b.n_functions)).sum()
}
