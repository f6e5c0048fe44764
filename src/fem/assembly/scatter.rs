//! Gathering of element contributions into forces and matrix, in the order of elements.

use super::pattern::{Pattern, Sources};
use crate::fem::element::ElementBlock;
use crate::geometry::Vector;
use rayon::prelude::*;

/// Generalised nodes, or block columns, that one task gathers.
const TASK: usize = 256;

/// For each generalised node, the places in the buffer of element forces that add up to its force.
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
        forces.par_iter_mut().enumerate().with_min_len(TASK).for_each(|(node, force)| {
            *force = Vector::zeros();
            for &place in &self.places[self.start[node] as usize..self.start[node + 1] as usize] {
                let f = &element_forces[3 * place as usize..3 * place as usize + 3];
                *force += Vector::new(f[0], f[1], f[2]);
            }
        });
    }
}

/// Writes the matrix's values from the lower triangles of the element matrices.
pub(super) fn gather_matrix(pattern: &Pattern, sources: &Sources, element_blocks: &[f64], values: &mut [f64]) {
    let mut tasks = Vec::with_capacity(pattern.n_columns() / TASK + 1);
    let mut rest = values;
    for from in (0..pattern.n_columns()).step_by(TASK) {
        let to = (from + TASK).min(pattern.n_columns());
        let (mine, tail) = rest.split_at_mut(pattern.value_start(to) - pattern.value_start(from));
        rest = tail;
        tasks.push((from..to, mine));
    }
    tasks.into_par_iter().for_each(|(columns, values)| {
        let first = pattern.value_start(columns.start);
        for column in columns {
            let n = pattern.rows(column).len();
            let begin = pattern.value_start(column);
            for place in 0..n {
                let mut sum = [0.0; 9];
                for &code in sources.of(begin / 9 + place) {
                    let block = &element_blocks[9 * (code / 2) as usize..9 * (code / 2) as usize + 9];
                    if code % 2 == 0 {
                        for i in 0..9 {
                            sum[i] += block[i];
                        }
                    } else {
                        for i in 0..9 {
                            sum[i] += block[3 * (i % 3) + i / 3];
                        }
                    }
                }
                for c in 0..3 {
                    let at = begin - first + 3 * n * c + 3 * place;
                    values[at..at + 3].copy_from_slice(&sum[3 * c..3 * c + 3]);
                }
            }
        }
    });
}
