/// Marks a position without a brick.
pub(super) const NO_BRICK: u32 = u32::MAX;
/// Number of codes read at once.
const WORD: usize = 4;

/// Coefficients of bricks of equal size, x fastest, coded in 16 bits.
#[derive(Debug, Clone)]
pub(super) struct Bricks {
    /// Codes of all bricks, then a brick of zeros that replaces missing ones, then padding for wide reads.
    codes: Vec<i16>,
    /// Value of one code step, mm.
    step: f64,
    /// Nodes along the edge of a brick.
    edge: usize,
    /// Number of bricks.
    count: u32,
}

prosopon_geometry::flat!(Bricks { codes, step, edge, count });

impl Bricks {
    /// Makes an empty store; coefficients are rounded to 1/32 767 of `largest` (mm) and clamped to it.
    pub(super) fn new(largest: f64, edge: usize) -> Self {
        Self { codes: vec![0; edge.pow(3) + WORD], step: largest / 32_767.0, edge, count: 0 }
    }

    fn volume(&self) -> usize {
        self.edge * self.edge * self.edge
    }

    /// Appends the codes of `coefficients` (mm) to `codes`.
    pub(super) fn pack(&self, coefficients: &[f32], codes: &mut Vec<i16>) {
        let inverse = 1.0 / self.step as f32;
        codes.extend(coefficients.iter().map(|c| code(c * inverse)));
    }

    /// Adds bricks with the given codes; returns the number of the first.
    pub(super) fn append(&mut self, codes: &[i16]) -> u32 {
        let first = self.count;
        self.codes.truncate(self.len() * self.volume());
        self.codes.extend_from_slice(codes);
        self.count += (codes.len() / self.volume()) as u32;
        self.codes.resize(self.codes.len() + self.volume() + WORD, 0);
        first
    }

    pub(super) fn len(&self) -> usize {
        self.count as usize
    }

    /// The codes of each brick in turn.
    pub(super) fn each_mut(&mut self) -> impl Iterator<Item = &mut [i16]> {
        let (end, volume) = (self.len() * self.volume(), self.volume());
        self.codes[..end].chunks_exact_mut(volume)
    }

    /// The codes of a brick.
    pub(super) fn of(&self, slot: u32) -> &[i16] {
        let (first, volume) = (slot as usize * self.volume(), self.volume());
        &self.codes[first..first + volume]
    }

    /// Code at a node of a brick; `place` counts x fastest.
    #[inline]
    pub(super) fn at(&self, slot: u32, place: usize) -> f64 {
        f64::from(self.codes[slot as usize * self.volume() + place])
    }

    /// Value of one code step, mm.
    #[inline(always)]
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Number of the brick of zeros.
    #[inline(always)]
    pub(super) fn none(&self) -> u32 {
        self.count
    }

    /// Codes around a node as words of four, one row along x each, y fastest; the fourth code is padding.
    ///
    /// `slots` are the node's brick and those of its neighbours: bit a of the index selects the other brick along axis a.
    /// `EDGE` is the edge of the bricks in nodes.
    #[inline(always)]
    pub(super) fn around<const EDGE: usize>(&self, slots: &[u32; 8], local: [usize; 3]) -> [u64; 9] {
        let mut words = [0; 9];
        let start = |slot: usize| slots[slot] as usize * (EDGE * EDGE * EDGE);
        if is_within(local, EDGE) {
            let codes = &self.codes[start(0) + place(EDGE, [local[0] - 1, local[1] - 1, local[2] - 1])..];
            let codes = &codes[..2 * EDGE * (1 + EDGE) + WORD];
            for k in 0..3 {
                for j in 0..3 {
                    words[3 * k + j] = word(&codes[EDGE * (j + EDGE * k)..][..WORD]);
                }
            }
            return words;
        }
        let [y, z] = [Reach::of(local[1], EDGE), Reach::of(local[2], EDGE)];
        if local[0] > 0 && local[0] + 1 < EDGE {
            let starts = [start(0), start(2), start(4), start(6)];
            for k in 0..3 {
                for j in 0..3 {
                    let start = starts[y.lies[j] | z.lies[k] << 1] + EDGE * (y.places[j] + EDGE * z.places[k]);
                    words[3 * k + j] = word(&self.codes[start + local[0] - 1..][..WORD]);
                }
            }
            return words;
        }
        // The last word of one row and the first of the next row, which lies in the other brick.
        let (before, behind, shift) = if local[0] == 0 { (1, 0, 48) } else { (0, 1, 32) };
        let mut starts = [[0; 2]; 4];
        for (n, starts) in starts.iter_mut().enumerate() {
            *starts = [start(n << 1 | before) + EDGE - WORD, start(n << 1 | behind)];
        }
        for k in 0..3 {
            for j in 0..3 {
                let row = EDGE * (y.places[j] + EDGE * z.places[k]);
                let [low, high] = starts[y.lies[j] | z.lies[k] << 1];
                let (low, high) = (word(&self.codes[low + row..][..WORD]), word(&self.codes[high + row..][..WORD]));
                words[3 * k + j] = low >> shift | high << (64 - shift);
            }
        }
        words
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.codes[..])
    }

    /// Reserves memory for exactly `more` bricks.
    pub(super) fn reserve(&mut self, more: usize) {
        self.codes.reserve_exact(more * self.volume());
    }
}

/// Four codes, the first in the lowest bits.
#[inline(always)]
fn word(codes: &[i16]) -> u64 {
    let bits = |n: usize| u64::from(codes[n] as u16) << (16 * n);
    bits(0) | bits(1) | bits(2) | bits(3)
}

/// Rounds half away from zero; the cast saturates.
#[inline(always)]
pub(super) fn code(c: f32) -> i16 {
    (c + 0.5f32.copysign(c)) as i16
}

/// The three nodes around a node along one axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// Step to the other brick that holds one of them; 0 when they share a brick.
    pub(super) other: isize,
    /// For each node 1 when it lies in the other brick, else 0.
    pub(super) lies: [usize; 3],
    /// Index of each in its own brick.
    pub(super) places: [usize; 3],
}

impl Reach {
    /// The nodes around a node of a brick with `edge` (a power of two) nodes along the axis.
    #[inline(always)]
    pub(super) fn of(node: usize, edge: usize) -> Self {
        let local = node & (edge - 1);
        let (first, last) = (usize::from(local == 0), usize::from(local + 1 == edge));
        Self {
            other: last as isize - first as isize,
            lies: [first, 0, last],
            places: [(local + edge - 1) & (edge - 1), local, (local + 1) & (edge - 1)],
        }
    }
}

/// Whether the nodes around a node all lie in its brick.
#[inline(always)]
pub(super) fn is_within([x, y, z]: [usize; 3], edge: usize) -> bool {
    // Subtracting 1 wraps 0 to the largest number.
    let last = edge - 2;
    (x.wrapping_sub(1) < last) & (y.wrapping_sub(1) < last) & (z.wrapping_sub(1) < last)
}

/// Storage index of node (x, y, z) of a brick.
#[inline(always)]
pub(super) fn place(edge: usize, [x, y, z]: [usize; 3]) -> usize {
    x + edge * (y + edge * z)
}
