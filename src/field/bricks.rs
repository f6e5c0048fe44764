/// Marks a place without a brick.
pub(super) const NO_BRICK: u32 = u32::MAX;
/// Codes that are read at once.
const WORD: usize = 4;

/// Coefficients of bricks of equal size, x fastest, in 16 bits.
#[derive(Debug, Clone)]
pub(super) struct Bricks {
    /// Codes of all bricks, of one of zeros that stands for none, and as many more as a row reads too far.
    codes: Vec<i16>,
    /// What one step of the codes is worth, mm.
    step: f64,
    /// Nodes along the edge of a brick.
    edge: usize,
    /// Number of bricks.
    count: u32,
}

impl Bricks {
    /// No bricks yet; coefficients are rounded to 1/32 767 of `largest` (mm) and cut off there.
    pub(super) fn new(largest: f64, edge: usize) -> Self {
        Self { codes: vec![0; edge.pow(3) + WORD], step: largest / 32_767.0, edge, count: 0 }
    }

    fn volume(&self) -> usize {
        self.edge * self.edge * self.edge
    }

    /// Appends the codes of coefficients, mm, to `codes`.
    pub(super) fn pack(&self, coefficients: &[f32], codes: &mut Vec<i16>) {
        let inverse = 1.0 / self.step as f32;
        codes.extend(coefficients.iter().map(|c| code(c * inverse)));
    }

    /// Adds bricks with the given codes; the number of the first of them.
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

    /// The codes of every brick.
    pub(super) fn each_mut(&mut self) -> impl Iterator<Item = &mut [i16]> {
        let (end, volume) = (self.len() * self.volume(), self.volume());
        self.codes[..end].chunks_exact_mut(volume)
    }

    /// The codes of a brick.
    pub(super) fn of(&self, slot: u32) -> &[i16] {
        let (first, volume) = (slot as usize * self.volume(), self.volume());
        &self.codes[first..first + volume]
    }

    /// Code at a node of a brick (x fastest).
    #[inline]
    pub(super) fn at(&self, slot: u32, place: usize) -> f64 {
        f64::from(self.codes[slot as usize * self.volume() + place])
    }

    /// What one step of the codes is worth, mm.
    #[inline(always)]
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Number of the brick of zeros.
    #[inline(always)]
    pub(super) fn none(&self) -> u32 {
        self.count
    }

    /// The codes around a node as words of four, a row along x each, y fastest; the fourth does not count. `slots` has the numbers of
    /// its brick and of those that it touches: bit 0 for the other along x, and so on. `EDGE` is that of the bricks.
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
        // The last word of one row and the first of the next one in the other brick.
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

    /// Makes room for exactly `more` bricks.
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

/// Rounds half away from zero; the cast cuts off.
#[inline(always)]
pub(super) fn code(c: f32) -> i16 {
    (c + 0.5f32.copysign(c)) as i16
}

/// The three nodes around one along an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// Step to the other brick that they touch; 0 for none.
    pub(super) other: isize,
    /// Which of them lie in it.
    pub(super) lies: [usize; 3],
    /// Where each lies in its brick.
    pub(super) places: [usize; 3],
}

impl Reach {
    /// Around a node of a brick with `edge` (a power of two) nodes along an axis.
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

/// Whether the nodes around one lie in its brick.
#[inline(always)]
pub(super) fn is_within([x, y, z]: [usize; 3], edge: usize) -> bool {
    // 0 becomes the largest.
    let last = edge - 2;
    (x.wrapping_sub(1) < last) & (y.wrapping_sub(1) < last) & (z.wrapping_sub(1) < last)
}

/// Where the node (x, y, z) of a brick lies in its storage.
#[inline(always)]
pub(super) fn place(edge: usize, [x, y, z]: [usize; 3]) -> usize {
    x + edge * (y + edge * z)
}
