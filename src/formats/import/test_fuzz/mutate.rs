/// Pseudo-random numbers, the same for the same round.
#[derive(Debug)]
pub(super) struct Dice(u64);

impl Dice {
    pub(super) fn new(round: u64) -> Self {
        let mut dice = Self(round.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d);
        dice.below(2);
        dice
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % n.max(1)
    }
}

/// Extreme counts, lengths and offsets.
const HUGE: [u64; 10] =
    [0, 1, 0x7f, 0xff, 0xffff, 0x7fff_ffff, 0xffff_ffff, 0x1_0000_0001, 0x7fff_ffff_ffff_ffff, u64::MAX];
/// Words that replace a number in a text.
const WORDS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "3",
    "65536",
    "2147483648",
    "4294967295",
    "18446744073709551615",
    "99999999999999999999999",
    "1e308",
    "-1e-320",
    "nan",
    "inf",
    "0x10",
];

/// Damages a file in one way.
pub(super) fn mutate(file: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    if file.is_empty() {
        file.extend(other.iter().take(1 + dice.below(other.len())));
        return;
    }
    let at = place(file.len(), dice);
    match dice.below(9) {
        0 => file.truncate(at),
        1 => file[at] ^= 1 << dice.below(8),
        2 => file[at] = [0, 1, b' ', b'\n', b'-', b'<', 0x7f, 0x80, 0xff][dice.below(9)],
        3 => {
            let value = HUGE[dice.below(HUGE.len())];
            let width = [2, 4, 8][dice.below(3)];
            let bytes = if dice.below(2) == 0 {
                value.to_le_bytes()[..width].to_vec()
            } else {
                value.to_be_bytes()[8 - width..].to_vec()
            };
            let end = (at + width).min(file.len());
            file[at..end].copy_from_slice(&bytes[..end - at]);
        }
        4 => word(file, at, dice),
        5 => drop(file.drain(at..(at + 1 + dice.below(64)).min(file.len()))),
        6 => {
            let piece = file[at..(at + 1 + dice.below(200)).min(file.len())].to_vec();
            let to = place(file.len(), dice);
            file.splice(to..to, piece);
        }
        7 if !other.is_empty() => {
            let from = dice.below(other.len());
            let piece = &other[from..(from + 1 + dice.below(200)).min(other.len())];
            let end = if dice.below(2) == 0 { at } else { (at + piece.len()).min(file.len()) };
            file.splice(at..end, piece.iter().copied());
        }
        _ => {
            let n = 1 + dice.below(8);
            let byte = dice.below(256) as u8;
            file.splice(at..at, std::iter::repeat_n(byte, n));
        }
    }
}

/// A random position, mostly near the beginning, where headers are.
fn place(length: usize, dice: &mut Dice) -> usize {
    if dice.below(3) > 0 { dice.below(length.min(600)) } else { dice.below(length) }
}

/// Replaces the next number from `at` on by a word.
fn word(file: &mut Vec<u8>, at: usize, dice: &mut Dice) {
    let number = |b: &u8| b.is_ascii_digit() || b"+-.".contains(b);
    let Some(from) = file[at..].iter().position(number).map(|n| at + n) else { return };
    let to = file[from..].iter().position(|b| !number(b)).map_or(file.len(), |n| from + n);
    file.splice(from..to, WORDS[dice.below(WORDS.len())].bytes());
}
