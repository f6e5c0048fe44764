//! Summation of element contributions into forces and matrix, in the order of elements.

use super::pattern::{NOWHERE, Pattern};
use crate::fem::element::ElementBlock;
use crate::fem::tuning::{MATRIX_PARTS, NODES_PER_TASK};
use prosopon_geometry::Vector;
use rayon::prelude::*;

/// For each generalised node, the entries in the buffer of element forces that add up to its force.
#[derive(Debug, Clone)]
pub(super) struct ForceSources {
    start: Vec<u32>,
    places: Vec<u32>,
}

impl ForceSources {
    pub(super) fn new(blocks: &[&ElementBlock], n_nodes: usize) -> Self {
        let all = || blocks.iter().flat_map(|b| &b.nodes);
        let mut start = vec![0u32; n_nodes + 1];
        for &node in all() {
            start[node as usize + 1] += 1;
        }
        for node in 0..n_nodes {
            start[node + 1] += start[node];
        }
        let mut next = start.clone();
        let mut places = vec![0u32; start[n_nodes] as usize];
        for (place, &node) in all().enumerate() {
            places[next[node as usize] as usize] = place as u32;
            next[node as usize] += 1;
        }
        Self { start, places }
    }

    pub(super) fn gather(&self, element_forces: &[f64], forces: &mut [Vector]) {
        forces.par_iter_mut().enumerate().with_min_len(NODES_PER_TASK).for_each(|(node, force)| {
            *force = Vector::zeros();
            for &place in &self.places[self.start[node] as usize..self.start[node + 1] as usize] {
                let f = &element_forces[3 * place as usize..3 * place as usize + 3];
                *force += Vector::new(f[0], f[1], f[2]);
            }
        });
    }
}

/// Adds element matrices to the values of the global matrix, a chunk of elements at a time.
#[derive(Debug, Clone)]
pub(super) struct Scatter {
    /// Ranges of block columns with about the same number of blocks.
    ranges: Vec<std::ops::Range<usize>>,
    /// Offset of each block's first value from the start of its column's range.
    offsets: Vec<u32>,
    /// Offset from one scalar column of a block to the next.
    strides: Vec<u32>,
}

impl Scatter {
    pub(super) fn new(pattern: &Pattern) -> Self {
        let per_range = pattern.n_blocks().div_ceil(MATRIX_PARTS).max(1);
        let mut ranges = Vec::new();
        let (mut offsets, mut strides) = (Vec::new(), Vec::new());
        let mut from = 0;
        for column in 0..pattern.n_columns() {
            let first = pattern.value_start(from);
            let rows = pattern.rows(column).len();
            let begin = pattern.value_start(column) - first;
            offsets.extend((0..rows).map(|place| (begin + 3 * place) as u32));
            strides.extend((0..rows).map(|_| 3 * rows as u32));
            let end = column + 1;
            if pattern.block_start(end) - pattern.block_start(from) >= per_range || end == pattern.n_columns() {
                ranges.push(from..end);
                from = end;
            }
        }
        Self { ranges, offsets, strides }
    }

    /// Adds the element blocks with these codes. Each value sums its contributions in the order of the codes at any number of
    /// threads.
    pub(super) fn add(&self, pattern: &Pattern, codes: &[u32], element_blocks: &[f64], values: &mut [f64]) {
        let mut tasks = Vec::with_capacity(self.ranges.len());
        let mut rest = values;
        for range in &self.ranges {
            let length = pattern.value_start(range.end) - pattern.value_start(range.start);
            let (mine, tail) = rest.split_at_mut(length);
            rest = tail;
            tasks.push((pattern.block_start(range.start) as u32..pattern.block_start(range.end) as u32, mine));
        }
        let (element_blocks, _) = element_blocks.as_chunks::<9>();
        tasks.into_par_iter().for_each(|(blocks, values)| {
            for (code, block) in codes.iter().zip(element_blocks) {
                let target = code / 2;
                if *code == NOWHERE || !blocks.contains(&target) {
                    continue;
                }
                let (at, stride) = (self.offsets[target as usize] as usize, self.strides[target as usize] as usize);
                for c in 0..3 {
                    let column = &mut values[at + stride * c..at + stride * c + 3];
                    for (r, value) in column.iter_mut().enumerate() {
                        *value += if code % 2 == 0 { block[3 * c + r] } else { block[3 * r + c] };
                    }
                }
            }
        });
    }
}
