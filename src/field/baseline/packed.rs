use super::settings::EDGE;

/// Nodes along the edge of a brick, shared ones included.
pub(super) const SIDE: usize = EDGE + 1;
/// Nodes of a brick.
pub(super) const NODES: usize = SIDE * SIDE * SIDE;
/// Number of 64-bit words with one bit per node.
const WORDS: usize = NODES.div_ceil(64);
/// Codes up to this magnitude count fine steps.
const FINE: f32 = 30_000.0;

/// Codes distances in 16 bits: fine steps up to `fine_mm`, coarse ones beyond.
///
/// # Accuracy
/// Half a step: `fine_mm` / 60 000 in the fine range, `largest_mm` / 5534 beyond. Larger values become `largest_mm`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Codec {
    fine: f32,
    /// Additional length of a step beyond [`FINE`], mm.
    extra: f32,
}

impl Codec {
    pub(super) fn new(fine_mm: f64, largest_mm: f64) -> Self {
        let fine = fine_mm as f32 / FINE;
        let coarse = (largest_mm - fine_mm) as f32 / (f32::from(i16::MAX) - FINE);
        Self { fine, extra: (coarse - fine).max(0.0) }
    }

    /// Largest rounding error of a value in the fine range, mm.
    pub(super) fn half_step(&self) -> f32 {
        0.5 * self.fine
    }

    pub(super) fn encode(&self, value: f32) -> i16 {
        let steps = value.abs() / self.fine;
        let code = if steps <= FINE { steps } else { FINE + (steps - FINE) * self.fine / (self.fine + self.extra) };
        code.round().min(f32::from(i16::MAX)).copysign(value) as i16
    }

    pub(super) fn decode(&self, code: i16) -> f32 {
        let size = f32::from(code).abs();
        (size * self.fine + (size - FINE).max(0.0) * self.extra).copysign(f32::from(code))
    }

    /// The value after coding and decoding, mm.
    pub(super) fn rounded(&self, value: f32) -> f32 {
        self.decode(self.encode(value))
    }
}

/// Divided cells of a brick: the octree from one cell of 8³ finest cells down to those.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Splits {
    /// Divided cells among the eight of 4³, bit x + 2 y + 4 z.
    pub(super) fours: u8,
    /// Divided cells among the 64 of 2³, bit x + 4 y + 16 z.
    pub(super) twos: u64,
}

impl Splits {
    pub(super) fn two(at: [usize; 3]) -> usize {
        at[0] / 2 + 4 * (at[1] / 2 + 4 * (at[2] / 2))
    }

    pub(super) fn four(at: [usize; 3]) -> usize {
        at[0] / 4 + 2 * (at[1] / 4 + 2 * (at[2] / 4))
    }

    /// First node and size of the leaf that holds finest cell `at`.
    pub(super) fn leaf(&self, at: [usize; 3]) -> ([usize; 3], usize) {
        let size = if self.fours >> Self::four(at) & 1 == 0 {
            4
        } else if self.twos >> Self::two(at) & 1 == 0 {
            2
        } else {
            1
        };
        (at.map(|a| a & !(size - 1)), size)
    }

    /// Calls `found` with the first node and the size of every leaf.
    fn for_leaves(&self, mut found: impl FnMut([usize; 3], usize)) {
        for n in 0..EDGE * EDGE * EDGE {
            let at = [n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)];
            let (first, size) = self.leaf(at);
            if first == at {
                found(first, size);
            }
        }
    }
}

/// Index of a node in its brick.
pub(super) fn node(at: [usize; 3]) -> usize {
    at[0] + SIDE * (at[1] + SIDE * at[2])
}

/// A divided brick: its leaves, and the nodes that have a value.
#[derive(Debug, Clone)]
pub(super) struct Packed {
    splits: Splits,
    /// One bit for each node; set where it has a value.
    stored: [u64; WORDS],
    /// Number of stored nodes before each word.
    before: [u16; WORDS],
    /// Index of the brick's first value.
    pub(super) first: u32,
}

impl Packed {
    /// Packs the values that the leaves of `splits` need.
    ///
    /// Appends the values to `codes`; also returns the number of leaves.
    pub(super) fn new(splits: Splits, values: &[f32; NODES], codec: &Codec, codes: &mut Vec<i16>) -> (Self, usize) {
        let mut stored = [0u64; WORDS];
        let mut leaves = 0;
        splits.for_leaves(|first, size| {
            leaves += 1;
            for c in 0..8 {
                let n = node([0, 1, 2].map(|a| first[a] + (c >> a & 1) * size));
                stored[n / 64] |= 1 << (n % 64);
            }
        });
        let start = codes.len() as u32;
        codes.extend((0..NODES).filter(|n| stored[n / 64] >> (n % 64) & 1 == 1).map(|n| codec.encode(values[n])));
        let mut before = [0u16; WORDS];
        for w in 1..WORDS {
            before[w] = before[w - 1] + stored[w - 1].count_ones() as u16;
        }
        (Self { splits, stored, before, first: start }, leaves)
    }

    /// The leaf that holds finest cell `at`: first node, size, and the codes of its corners.
    pub(super) fn leaf(&self, at: [usize; 3], codes: &[i16]) -> ([usize; 3], usize, [i16; 8]) {
        let (first, size) = self.splits.leaf(at);
        let mut corners = [0; 8];
        for (c, corner) in corners.iter_mut().enumerate() {
            let n = node([0, 1, 2].map(|a| first[a] + (c >> a & 1) * size));
            let (word, bit) = (n / 64, n % 64);
            let rank = self.before[word] as usize + (self.stored[word] & ((1 << bit) - 1)).count_ones() as usize;
            *corner = codes[self.first as usize + rank];
        }
        (first, size, corners)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_sign_and_stay_within_half_a_step() {
        let codec = Codec::new(6.0, 120.0);
        for n in -2000..=2000 {
            let v = n as f32 * 0.06;
            let step = if v.abs() <= 6.0 { 6.0 / 30_000.0 } else { 120.0 / 2767.0 };
            assert!((codec.rounded(v) - v).abs() <= 0.51 * step, "{v} {}", codec.rounded(v));
        }
        assert_eq!(codec.rounded(500.0), codec.rounded(120.0));
    }

    #[test]
    fn a_packed_brick_gives_back_every_leaf() {
        let values: [f32; NODES] = std::array::from_fn(|n| n as f32 * 0.001);
        let codec = Codec::new(1.0, 1.0);
        let splits = Splits { fours: 0b101, twos: 0b11 };
        let mut codes = vec![7; 5];
        let (packed, leaves) = Packed::new(splits, &values, &codec, &mut codes);
        assert_eq!(leaves, 6 + 2 * 8 - 2 + 16);
        let (first, size, corners) = packed.leaf([3, 1, 1], &codes);
        assert_eq!((first, size), ([3, 1, 1], 1));
        for (c, code) in corners.iter().enumerate() {
            let n = node([0, 1, 2].map(|a| first[a] + (c >> a & 1) * size));
            assert!((codec.decode(*code) - values[n]).abs() < 1e-4);
        }
        assert_eq!(packed.leaf([7, 7, 7], &codes).1, 4);
    }
}
