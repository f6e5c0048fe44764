use super::lattice::{BRICK, EDGE};
use super::spline::Rows;
use wide::{f64x4, i16x8, i32x4, i32x8};

/// Marks a place without a brick.
pub(super) const NO_BRICK: u32 = u32::MAX;
/// Codes that are read at once.
const PADDING: usize = 8;

/// Coefficients of 8³ nodes a brick, x fastest, in 16 bits.
#[derive(Debug, Clone)]
pub(super) struct Bricks {
    /// Codes of all bricks and as many more as a row reads too far.
    codes: Vec<i16>,
    /// What one step of the codes is worth, mm.
    step: f64,
}

impl Bricks {
    /// No bricks yet; coefficients are rounded to 1/32 767 of `largest` (mm) and cut off there.
    pub(super) fn new(largest: f64) -> Self {
        Self { codes: vec![0; PADDING], step: largest / 32_767.0 }
    }

    /// The codes of a brick's coefficients, mm.
    pub(super) fn packed(&self, coefficients: &[f32; BRICK]) -> Box<[i16; BRICK]> {
        let inverse = 1.0 / self.step as f32;
        let mut codes = Box::new([0i16; BRICK]);
        for (code, c) in codes.iter_mut().zip(coefficients) {
            // Half away from zero; the cast cuts off.
            *code = (c * inverse + 0.5f32.copysign(*c)) as i16;
        }
        codes
    }

    pub(super) fn push(&mut self, codes: &[i16; BRICK]) -> u32 {
        self.codes.truncate(self.codes.len() - PADDING);
        self.codes.extend_from_slice(codes);
        self.codes.extend([0; PADDING]);
        self.len() as u32 - 1
    }

    pub(super) fn len(&self) -> usize {
        self.codes.len() / BRICK
    }

    /// Code at a node of a brick (x fastest).
    #[inline]
    pub(super) fn at(&self, slot: u32, place: usize) -> f64 {
        f64::from(self.codes[slot as usize * BRICK + place])
    }

    /// What one step of the codes is worth, mm.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Three codes of a brick from `place` on; a fourth lane that does not count.
    #[inline(always)]
    fn row(&self, slot: u32, place: usize) -> f64x4 {
        let first = slot as usize * BRICK + place;
        let codes = i16x8::from_slice_unaligned(&self.codes[first..first + PADDING]);
        let [a, b, c, d, ..] = i32x8::from_i16x8(codes).to_array();
        f64x4::from_i32x4(i32x4::new([a, b, c, d]))
    }

    /// The codes around a node; `slots` are the bricks that hold the rows.
    #[inline(always)]
    pub(super) fn rows(&self, slots: impl Fn(usize, usize) -> u32, x: usize, y: &[usize; 3], z: &[usize; 3]) -> Rows {
        let mut rows = [f64x4::ZERO; 9];
        for k in 0..3 {
            for j in 0..3 {
                rows[3 * k + j] = self.row(slots(j, k), x + y[j] + z[k]);
            }
        }
        rows
    }

    /// The codes around a node, x fastest, whose bricks are `slots`; 0 where there is none.
    pub(super) fn some_around(&self, slots: &[u32; 8], [x, y, z]: &[Reach; 3]) -> [f64; 27] {
        let mut c = [0.0; 27];
        for k in 0..3 {
            for j in 0..3 {
                let (row, which) = (y.places[j] + z.places[k], y.lies[j] << 1 | z.lies[k] << 2);
                for i in 0..3 {
                    let slot = slots[which | x.lies[i]];
                    if slot != NO_BRICK {
                        c[9 * k + 3 * j + i] = self.at(slot, row + x.places[i]);
                    }
                }
            }
        }
        c
    }

    /// Takes `less` (mm) from the coefficients of a brick.
    pub(super) fn shift(&mut self, slot: usize, less: &[f32; BRICK]) {
        let step = self.step as f32;
        for (code, less) in self.codes[slot * BRICK..(slot + 1) * BRICK].iter_mut().zip(less) {
            *code = (f32::from(*code) - less / step).round() as i16;
        }
    }

    /// Sets the coefficients of a brick to 0 at the nodes that `goes` wants.
    pub(super) fn clear(&mut self, slot: usize, goes: impl Fn([usize; 3]) -> bool) {
        for (n, code) in self.codes[slot * BRICK..(slot + 1) * BRICK].iter_mut().enumerate() {
            if goes([n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)]) {
                *code = 0;
            }
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.codes[..])
    }

    /// Makes room for exactly `more` bricks.
    pub(super) fn reserve(&mut self, more: usize) {
        self.codes.reserve_exact(more * BRICK);
    }
}

/// The three nodes around one along an axis.
#[derive(Debug)]
pub(super) struct Reach {
    /// Step to the other brick that they touch; 0 for none.
    pub(super) other: isize,
    /// Which of them lie in it.
    pub(super) lies: [usize; 3],
    /// Where each lies in its brick's storage.
    pub(super) places: [usize; 3],
}

impl Reach {
    #[inline(always)]
    pub(super) fn of(node: usize, stride: usize) -> Self {
        let local = node % EDGE;
        let places = [(local + EDGE - 1) % EDGE * stride, local * stride, (local + 1) % EDGE * stride];
        match local {
            0 => Self { other: -1, lies: [1, 0, 0], places },
            l if l + 1 == EDGE => Self { other: 1, lies: [0, 0, 1], places },
            _ => Self { other: 0, lies: [0; 3], places },
        }
    }
}
