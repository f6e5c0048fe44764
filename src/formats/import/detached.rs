//! Names of voxel files that lie beside a header.

/// Returns the bytes of the file with that name, which lies beside the header.
pub(super) type Fetch<'a> = dyn FnMut(&str) -> Result<Vec<u8>, &'static str> + 'a;

/// Most files of one volume: one for each slice.
pub(super) const MAX_FILES: usize = 0x7fff;

/// Why the voxels of a file sent alone are not read.
pub(super) const SEPARATE: &str = "the voxels are in a separate file: send it with the header in one zip archive";

/// The names of `pattern first last step`, where the pattern has one `%d`, as in C, for example `slice%03d.raw 1 56 1`; `None` for
/// any other text, or too many names.
pub(super) fn numbered(text: &str) -> Option<Vec<String>> {
    let mut words: Vec<&str> = text.split_whitespace().collect();
    // A fourth number states how many dimensions each file has, which follows from their number.
    if words.len() > 4 && words.get(1..)?.iter().all(|w| w.parse::<i64>().is_ok()) {
        words.truncate(4);
    }
    let [pattern, numbers @ ..] = words.as_slice() else { return None };
    let [first, last, step] = match numbers {
        [a, b, c] => [a, b, c].map(|w| w.parse::<i64>().ok()),
        [a, b] => [a.parse().ok(), b.parse().ok(), Some(1)],
        _ => return None,
    };
    let (first, last, step) = (first?, last?, step?);
    let (before, rest) = pattern.split_once('%')?;
    let end = rest.find(['d', 'i', 'u'])?;
    let (width, after) = (rest.get(..end)?, rest.get(end.checked_add(1)?..)?);
    let has_zeros = width.starts_with('0');
    let width = if width.is_empty() { 0 } else { width.parse::<usize>().ok().filter(|w| *w <= 20)? };
    if after.contains('%') || step == 0 || (step > 0) != (last >= first) && first != last {
        return None;
    }
    let count = last.checked_sub(first)?.checked_div(step)?.checked_add(1)?;
    let count = usize::try_from(count).ok().filter(|n| (1..=MAX_FILES).contains(n))?;
    let name = |k: usize| {
        let number = first.checked_add(step.checked_mul(i64::try_from(k).ok()?)?)?;
        Some(if has_zeros {
            format!("{before}{number:0width$}{after}")
        } else {
            format!("{before}{number:width$}{after}")
        })
    };
    (0..count).map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_take_the_place_of_the_pattern() {
        assert_eq!(numbered("a%03d.raw 8 12 2").unwrap(), ["a008.raw", "a010.raw", "a012.raw"]);
        assert_eq!(numbered("a%d 2 1 -1 2").unwrap(), ["a2", "a1"]);
        assert_eq!(numbered("a%02i.z 9 10").unwrap(), ["a09.z", "a10.z"]);
        for text in
            ["a%s 1 2 1", "a%d", "a 1 2 1", "a%d%d 1 2 1", "a%d 1 2 0", "a%d 1 2 -1", "a%d 1 999999 1", "a%99d 1 2 1"]
        {
            assert_eq!(numbered(text), None, "{text}");
        }
    }
}
