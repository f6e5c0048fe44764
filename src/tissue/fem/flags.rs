//! Sets of flags as lists of indices.

/// Indices of the flags that are set.
pub(super) fn pairs(flags: &[bool]) -> Vec<u64> {
    flags.iter().enumerate().filter(|(_, set)| **set).map(|(pair, _)| pair as u64).collect()
}

/// `n` flags with those of `pairs` set; `None` when an index is out of range.
pub(super) fn flags(pairs: &[u64], n: usize) -> Option<Vec<bool>> {
    let mut flags = vec![false; n];
    for pair in pairs {
        *flags.get_mut(usize::try_from(*pair).ok()?)? = true;
    }
    Some(flags)
}
