//! Sparsity of the stiffness matrix and where each element's block goes.

use super::kernel::n_slots;
use crate::fem::dofs::Dofs;
use crate::fem::element::ElementBlock;
use crate::geometry::Vector;
use nalgebra::Matrix3;

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

    /// First value of column `column`.
    pub(in crate::fem) fn value_start(&self, column: usize) -> usize {
        9 * self.start[column]
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

    /// Takes unknowns out of the system: rows and columns of the axes (bits) of these unknown nodes become zero but for the diagonal.
    pub(in crate::fem) fn hold(&self, held: &[(u32, u8)], values: &mut [f64]) {
        if held.is_empty() {
            return;
        }
        let mut axes = vec![0u8; self.n_columns()];
        for &(unknown, bits) in held {
            axes[unknown as usize] = bits;
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

    /// `y = A x`.
    pub(in crate::fem) fn multiply(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for column in 0..self.n_columns() {
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

/// For each block of the pattern, the element blocks that add up to it, in the order of elements.
#[derive(Debug, Clone)]
pub(super) struct Sources {
    start: Vec<u32>,
    /// Twice the slot, plus one when the slot's block is to be transposed.
    codes: Vec<u32>,
}

impl Sources {
    pub(super) fn of(&self, block: usize) -> &[u32] {
        &self.codes[self.start[block] as usize..self.start[block + 1] as usize]
    }
}

/// Pattern and sources. Slots are numbered through all blocks of elements, elements, and local pairs `(a, b)`, `a >= b`.
pub(super) fn build(blocks: &[&ElementBlock], dofs: &Dofs) -> (Pattern, Sources) {
    let mut entries: Vec<(u32, u32, u32)> = Vec::new();
    let mut slot = 0u32;
    for block in blocks {
        for nodes in block.nodes.chunks_exact(block.n_functions) {
            for (a, &node_a) in nodes.iter().enumerate() {
                for &node_b in &nodes[..=a] {
                    if let (Some(ua), Some(ub)) = (dofs.unknown(node_a), dofs.unknown(node_b)) {
                        entries.push((ua.min(ub), ua.max(ub), 2 * slot + u32::from(ua < ub)));
                    }
                    slot += 1;
                }
            }
        }
    }
    entries.sort_unstable();
    let mut start = vec![0usize; dofs.n_unknown() + 1];
    let mut rows = Vec::new();
    let mut source_start = vec![0u32];
    for same in entries.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        rows.push(same[0].1);
        start[same[0].0 as usize + 1] += 1;
        source_start.push(source_start[rows.len() - 1] + same.len() as u32);
    }
    for column in 0..dofs.n_unknown() {
        start[column + 1] += start[column];
    }
    let codes = entries.iter().map(|e| e.2).collect();
    (Pattern { start, rows }, Sources { start: source_start, codes })
}

/// Total number of slots.
pub(super) fn total_slots(blocks: &[&ElementBlock]) -> usize {
    blocks.iter().map(|b| b.n_elements() * n_slots(b.n_functions)).sum()
}
