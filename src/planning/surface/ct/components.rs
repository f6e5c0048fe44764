//! Connected components of a mask on a lattice.

/// Components of a mask whose samples are connected through faces.
pub(super) struct Components {
    runs: Vec<Run>,
    /// Per component: number of samples.
    pub(super) sizes: Vec<usize>,
    /// Per component: whether it reaches the border of the lattice, or of the plane when there is only one.
    pub(super) at_border: Vec<bool>,
    n_samples: usize,
}

/// Samples `start..end` of one row.
struct Run {
    start: usize,
    end: usize,
    component: u32,
}

impl Components {
    pub(super) fn of(mask: &[bool], dims: [usize; 3]) -> Self {
        let [nx, ny, nz] = dims;
        let mut runs: Vec<Run> = Vec::new();
        let mut first_of_row = Vec::with_capacity(ny * nz + 1);
        for (row, samples) in mask.chunks(nx).enumerate() {
            first_of_row.push(runs.len());
            let mut i = 0;
            while i < nx {
                if !samples[i] {
                    i += 1;
                    continue;
                }
                let length = samples[i..].iter().take_while(|s| **s).count();
                let component = runs.len() as u32;
                runs.push(Run { start: row * nx + i, end: row * nx + i + length, component });
                i += length;
            }
        }
        first_of_row.push(runs.len());
        let mut parent: Vec<u32> = (0..runs.len() as u32).collect();
        for row in 0..ny * nz {
            if row % ny > 0 {
                join_rows(&runs, &mut parent, &first_of_row, row, row - 1, nx);
            }
            if row >= ny {
                join_rows(&runs, &mut parent, &first_of_row, row, row - ny, nx);
            }
        }
        let mut found = Self { runs, sizes: Vec::new(), at_border: Vec::new(), n_samples: mask.len() };
        found.number(&mut parent, dims);
        found
    }

    fn number(&mut self, parent: &mut [u32], [nx, ny, nz]: [usize; 3]) {
        let mut number = vec![u32::MAX; parent.len()];
        for (index, run) in self.runs.iter_mut().enumerate() {
            let root = find(parent, index as u32) as usize;
            if number[root] == u32::MAX {
                number[root] = self.sizes.len() as u32;
                self.sizes.push(0);
                self.at_border.push(false);
            }
            run.component = number[root];
            self.sizes[run.component as usize] += run.end - run.start;
            let row = run.start / nx;
            let (j, k) = (row % ny, row / ny);
            self.at_border[run.component as usize] |= run.start % nx == 0
                || run.end % nx == 0
                || j == 0
                || j == ny - 1
                || (nz > 1 && (k == 0 || k == nz - 1));
        }
    }

    /// The component with the most samples; the first one of equals.
    pub(super) fn largest(&self) -> Option<usize> {
        (0..self.sizes.len()).rev().max_by_key(|&c| self.sizes[c])
    }

    /// Per component: whether any of its samples is marked.
    pub(super) fn any(&self, marked: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut found = vec![false; self.sizes.len()];
        for run in &self.runs {
            found[run.component as usize] |= (run.start..run.end).any(&marked);
        }
        found
    }

    /// Samples of the components for which `keep` holds.
    pub(super) fn mask(&self, keep: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut mask = vec![false; self.n_samples];
        for run in self.runs.iter().filter(|r| keep(r.component as usize)) {
            mask[run.start..run.end].fill(true);
        }
        mask
    }
}

fn join_rows(runs: &[Run], parent: &mut [u32], first_of_row: &[usize], row: usize, other: usize, nx: usize) {
    let (mut a, mut b) = (first_of_row[row], first_of_row[other]);
    let (end_a, end_b) = (first_of_row[row + 1], first_of_row[other + 1]);
    let shift = (row - other) * nx;
    while a < end_a && b < end_b {
        if runs[a].start < runs[b].end + shift && runs[b].start + shift < runs[a].end {
            let (x, y) = (find(parent, a as u32), find(parent, b as u32));
            parent[x.max(y) as usize] = x.min(y);
        }
        if runs[a].end < runs[b].end + shift { a += 1 } else { b += 1 }
    }
}

fn find(parent: &mut [u32], of: u32) -> u32 {
    let mut at = of as usize;
    while parent[at] != at as u32 {
        parent[at] = parent[parent[at] as usize];
        at = parent[at] as usize;
    }
    at as u32
}

#[cfg(test)]
mod tests {
    use super::super::test_masks::{place, speckle};
    use super::*;

    #[test]
    fn components_are_those_of_a_flood() {
        let dims = [11, 8, 9];
        for n in [2, 3] {
            let mask = speckle(dims, n);
            let components = Components::of(&mask, dims);
            let mut seen = vec![false; mask.len()];
            let mut sizes = Vec::new();
            for start in 0..mask.len() {
                if !mask[start] || seen[start] {
                    continue;
                }
                let (mut stack, mut flood, mut at_border) = (vec![start], vec![false; mask.len()], false);
                seen[start] = true;
                while let Some(at) = stack.pop() {
                    flood[at] = true;
                    let p = place(at, dims);
                    at_border |= (0..3).any(|a| p[a] == 0 || p[a] == dims[a] as i64 - 1);
                    for (a, step) in [(0, 1), (1, dims[0]), (2, dims[0] * dims[1])] {
                        let mut visit = |ok: bool, q: usize| {
                            if ok && mask[q] && !seen[q] {
                                seen[q] = true;
                                stack.push(q);
                            }
                        };
                        visit(p[a] > 0, at.wrapping_sub(step));
                        visit(p[a] + 1 < dims[a] as i64, (at + step).min(mask.len() - 1));
                    }
                }
                let index = sizes.len();
                sizes.push(flood.iter().filter(|f| **f).count());
                assert_eq!(components.mask(|c| c == index), flood);
                assert_eq!(components.at_border[index], at_border);
            }
            assert_eq!(components.sizes, sizes);
            let largest = components.largest().unwrap();
            assert_eq!(sizes[largest], *sizes.iter().max().unwrap());
        }
    }
}
