//! Masks for tests.

/// Deterministic mask with about one sample in `n` set.
pub(super) fn speckle(dims: [usize; 3], n: usize) -> Vec<bool> {
    (0..dims.iter().product::<usize>()).map(|i| (i * 7919 + i * i * 31) % 1009 % n == 0).collect()
}

pub(super) fn place(at: usize, dims: [usize; 3]) -> [i64; 3] {
    [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]].map(|c| c as i64)
}
