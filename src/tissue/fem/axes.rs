//! Sets of coordinate axes as bits: x = 1, y = 2, z = 4.

/// All three axes.
pub(super) const ALL_AXES: u8 = 7;

/// Indices of the axes whose bits are set.
pub(super) fn axes_in(bits: u8) -> impl Iterator<Item = usize> {
    (0..3).filter(move |axis| bits >> axis & 1 == 1)
}
