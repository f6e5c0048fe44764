use super::lattice::EDGE;
use super::spline::Rows;

/// Marks a place without a brick.
pub(super) const NO_BRICK: u32 = u32::MAX;
/// Codes that are read at once.
const LANES: usize = 4;

/// Coefficients of bricks of equal size, x fastest, in 16 bits.
#[derive(Debug, Clone)]
pub(super) struct Bricks {
    /// Codes of all bricks and as many more as a row reads too far.
    codes: Vec<i16>,
    /// What one step of the codes is worth, mm.
    step: f64,
    /// Nodes along the edge of a brick.
    edge: usize,
}

impl Bricks {
    /// No bricks yet; coefficients are rounded to 1/32 767 of `largest` (mm) and cut off there.
    pub(super) fn new(largest: f64, edge: usize) -> Self {
        Self { codes: vec![0; LANES], step: largest / 32_767.0, edge }
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
        let first = self.len() as u32;
        self.codes.truncate(self.codes.len() - LANES);
        self.codes.extend_from_slice(codes);
        self.codes.extend([0; LANES]);
        first
    }

    pub(super) fn len(&self) -> usize {
        (self.codes.len() - LANES) / self.volume()
    }

    /// The codes of every brick.
    pub(super) fn each_mut(&mut self) -> impl Iterator<Item = &mut [i16]> {
        let (end, volume) = (self.codes.len() - LANES, self.volume());
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

    /// The codes around a node whose first row along x begins at `first[j][k]` among all codes, and does not leave its brick.
    #[inline(always)]
    pub(super) fn rows(&self, first: &[[usize; 3]; 3]) -> Rows {
        let mut rows = [[0.0; 4]; 9];
        for k in 0..3 {
            for j in 0..3 {
                let row = &self.codes[first[k][j]..first[k][j] + LANES];
                rows[3 * k + j] = [f64::from(row[0]), f64::from(row[1]), f64::from(row[2]), f64::from(row[3])];
            }
        }
        rows
    }

    /// The codes around a node: the one along x that column i takes is `x[i]` from the row's begin in its side's brick.
    #[inline(always)]
    pub(super) fn columns(&self, first: &[[[usize; 3]; 3]; 2], x: &Reach) -> Rows {
        let mut rows = [[0.0; 4]; 9];
        for k in 0..3 {
            for j in 0..3 {
                for i in 0..3 {
                    rows[3 * k + j][i] = f64::from(self.codes[first[x.lies[i]][k][j] + x.places[i]]);
                }
            }
        }
        rows
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.codes[..])
    }

    /// Makes room for exactly `more` bricks.
    pub(super) fn reserve(&mut self, more: usize) {
        self.codes.reserve_exact(more * self.volume());
    }
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

    /// Whether all three lie in one brick.
    #[inline(always)]
    pub(super) fn is_inner(&self) -> bool {
        self.other == 0
    }
}

/// Where the node (x, y, z) of a brick lies in its storage.
pub(super) fn place(edge: usize, [x, y, z]: [usize; 3]) -> usize {
    x + edge * (y + edge * z)
}

/// The same for nodes of [`EDGE`].
#[inline(always)]
pub(super) fn row_of(y: usize, z: usize) -> usize {
    EDGE * (y + EDGE * z)
}
