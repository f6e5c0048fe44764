//! Visibility: the share of all directions in which a node of a grid sees out.

use prosopon_geometry::control::{Cancelled, Control};
use rayon::prelude::*;

/// Number of directions swept at the same time; fixed, so that memory does not grow with threads.
const CHUNK: usize = 7;
/// Binary digits that count up to 98 directions.
const DIGITS: usize = 7;

/// Share of directions in which a ray over `free` nodes leaves the grid, by node; 0 at other nodes.
///
/// The directions are the primitive lattice directions of at most `most_steps` node spacings, and at most 3: 98 at most.
pub(super) fn visibility(
    dims: [usize; 3],
    free: &[bool],
    most_steps: f64,
    control: &Control,
) -> Result<Vec<f32>, Cancelled> {
    let directions = directions(most_steps);
    let free = Bits::of(dims, free);
    let mut counts: [Vec<u64>; DIGITS] = std::array::from_fn(|_| vec![0; free.words.len()]);
    for (n, chunk) in directions.chunks(CHUNK).enumerate() {
        control.check()?;
        control.report((n * CHUNK) as f64 / directions.len() as f64);
        let open: Vec<Bits> = chunk.par_iter().map(|&direction| free.unblocked(direction)).collect();
        for bits in &open {
            for (at, word) in bits.words.iter().enumerate() {
                let mut carry = *word;
                for digit in &mut counts {
                    let count = &mut digit[at];
                    (*count, carry) = (*count ^ carry, *count & carry);
                }
            }
        }
    }
    let share = 1.0 / directions.len() as f32;
    let counted = |n: usize| {
        let (word, bit) = (free.row_words * (n / dims[0]) + n % dims[0] / 64, n % dims[0] % 64);
        let count = counts.iter().rev().fold(0, |count, digit| 2 * count + (digit[word] >> bit & 1));
        count as f32 * share
    };
    Ok((0..dims.iter().product()).into_par_iter().map(counted).collect())
}

fn directions(most_steps: f64) -> Vec<[i32; 3]> {
    let mut directions = Vec::new();
    for z in -2i32..=2 {
        for y in -2i32..=2 {
            for x in -2i32..=2 {
                let length_sq = x * x + y * y + z * z;
                let is_primitive = x % 2 != 0 || y % 2 != 0 || z % 2 != 0;
                if is_primitive && length_sq <= 9 && f64::from(length_sq).sqrt() <= most_steps.max(1.0) {
                    directions.push([x, y, z]);
                }
            }
        }
    }
    directions
}

/// One bit for each node of a grid. Each row along x begins with a new word; bits after its last node are set.
struct Bits {
    dims: [usize; 3],
    row_words: usize,
    words: Vec<u64>,
}

impl Bits {
    fn of(dims: [usize; 3], set: &[bool]) -> Self {
        let row_words = dims[0].div_ceil(64);
        let mut words = Vec::with_capacity(row_words * dims[1] * dims[2]);
        for row in set.chunks(dims[0]) {
            for nodes in row.chunks(64) {
                let bits = nodes.iter().enumerate().fold(0, |word, (bit, set)| word | u64::from(*set) << bit);
                words.push(bits | u64::MAX.checked_shl(nodes.len() as u32).unwrap_or(0));
            }
        }
        Self { dims, row_words, words }
    }

    /// The nodes of this set from which a ray in a direction leaves the grid over nodes of the set.
    fn unblocked(&self, [dx, dy, dz]: [i32; 3]) -> Self {
        let [_, ny, nz] = self.dims;
        let mut open = Self { words: vec![0; self.words.len()], ..*self };
        // A row takes the result of the row where its rays go next, so that one comes first.
        let order = |n: usize, d: i32| (0..n).map(move |i| if d > 0 { n - 1 - i } else { i });
        let next = |i: usize, d: i32, n: usize| i.checked_add_signed(d as isize).filter(|to| *to < n);
        for k in order(nz, dz) {
            for j in order(ny, dy) {
                let row = self.row_words * (j + ny * k);
                match (next(j, dy, ny), next(k, dz, nz)) {
                    (Some(y), Some(z)) if (y, z) == (j, k) => self.unblocked_in_row(row, dx > 0, &mut open.words),
                    (Some(y), Some(z)) => {
                        let seen = self.row_words * (y + ny * z);
                        for w in 0..self.row_words {
                            open.words[row + w] = self.words[row + w] & open.moved(seen, w, dx);
                        }
                        open.words[row + self.row_words - 1] |= self.padding();
                    }
                    _ => open.words[row..row + self.row_words].copy_from_slice(&self.words[row..row + self.row_words]),
                }
            }
        }
        open
    }

    /// As [`Self::unblocked`] for rays along the row that begins at word `row`, upwards or downwards.
    fn unblocked_in_row(&self, row: usize, upwards: bool, open: &mut [u64]) {
        for step in 0..self.row_words {
            let w = if upwards { self.row_words - 1 - step } else { step };
            let word = self.words[row + w];
            // The bits from the end where the rays leave to the first bit that is not set.
            let run = if upwards { word.leading_ones() } else { word.trailing_ones() };
            let all = u64::MAX;
            let run_bits =
                if upwards { all.checked_shl(64 - run).unwrap_or(0) } else { !all.checked_shl(run).unwrap_or(0) };
            open[row + w] = run_bits;
            if run < 64 {
                break;
            }
        }
        open[row + self.row_words - 1] |= self.padding();
    }

    /// Word `w` of the row at word `row`, moved so that each node has the bit of the node `dx` after it; outside all are set.
    fn moved(&self, row: usize, w: usize, dx: i32) -> u64 {
        let (word, by) = (self.words[row + w], dx.unsigned_abs());
        match dx.signum() {
            1 => {
                let after = if w + 1 < self.row_words { self.words[row + w + 1] } else { u64::MAX };
                word >> by | after << (64 - by)
            }
            -1 => {
                let before = if w > 0 { self.words[row + w - 1] } else { u64::MAX };
                word << by | before >> (64 - by)
            }
            _ => word,
        }
    }

    /// The bits after the last node of a row.
    fn padding(&self) -> u64 {
        match self.dims[0] % 64 {
            0 => 0,
            used => u64::MAX << used,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_over_a_wall_sees_half_of_all_directions_and_one_in_a_closed_room_none() {
        let dims = [41, 41, 41];
        let at = |n: usize| [n % 41, n / 41 % 41, n / 1681];
        let floor: Vec<bool> = (0..41 * 41 * 41).map(|n| at(n)[2] > 3).collect();
        let over_floor = visibility(dims, &floor, 3.0, &Control::new()).unwrap();
        let n = 20 + 41 * (20 + 41 * 4);
        // Of the 98 directions 41 point upwards and 16 lie in the plane of the floor.
        assert!((over_floor[n] - 57.0 / 98.0).abs() < 1e-6, "{}", over_floor[n]);
        // The wall is two nodes thick, as the longest step requires.
        let room: Vec<bool> = (0..41 * 41 * 41)
            .map(|n| {
                let d = at(n).map(|i| i.abs_diff(20)).into_iter().max().unwrap_or(0);
                !(8..11).contains(&d)
            })
            .collect();
        let in_room = visibility(dims, &room, 3.0, &Control::new()).unwrap();
        assert_eq!(in_room[20 + 41 * (20 + 41 * 20)], 0.0);
        assert!(in_room[0] > 0.8);
    }

    #[test]
    fn the_shares_are_those_of_rays_followed_node_by_node() {
        // Rows that end before, at and after the end of a word.
        for dims in [[5, 6, 4], [64, 5, 7], [65, 4, 5], [130, 3, 4]] {
            let count: usize = dims.iter().product();
            let free: Vec<bool> = (0..count as u64).map(|n| n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 61 > 0).collect();
            let found = visibility(dims, &free, 3.0, &Control::new()).unwrap();
            let all = directions(3.0);
            let leaves = |n: usize, d: &[i32; 3]| {
                let mut at = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
                loop {
                    if !free[at[0] + dims[0] * (at[1] + dims[1] * at[2])] {
                        return false;
                    }
                    for a in 0..3 {
                        match at[a].checked_add_signed(d[a] as isize).filter(|to| *to < dims[a]) {
                            Some(to) => at[a] = to,
                            None => return true,
                        }
                    }
                }
            };
            for n in 0..count {
                let expected = all.iter().filter(|d| leaves(n, d)).count() as f32 / all.len() as f32;
                assert!((found[n] - expected).abs() < 1e-6, "{dims:?}, node {n}: {} and {expected}", found[n]);
            }
        }
    }

    #[test]
    fn short_steps_leave_out_the_long_directions() {
        assert_eq!([1.0, 2.0, 2.5, 3.0].map(|most| directions(most).len()), [6, 26, 74, 98]);
    }
}
