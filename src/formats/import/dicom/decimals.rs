//! Reads decimal strings (DS), also those that a program wrote with its user's decimal comma.

/// Numbers of one attribute.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Decimals {
    pub(super) values: Vec<f64>,
    /// Whether commas were read as decimal points or as separators.
    pub(super) had_commas: bool,
}

/// Why an attribute's text gives no numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unread {
    /// A word is not a finite number.
    NotNumbers,
    /// It has commas, and more than one reading of them is possible.
    Doubtful,
}

/// Most numbers of an attribute that are read.
const MAX_NUMBERS: usize = 16;

/// The finite numbers in `text`, of which the attribute has `expected`.
///
/// A comma becomes a decimal point where the backslashes separate `expected` words, and where a text without backslashes has
/// twice as many digit groups. It separates numbers where there are `expected` words between commas, at least four or with
/// points. `may_group` refuses `1,024`, which may be a thousand and 24.
pub(super) fn read(text: &[u8], expected: usize, may_group: bool) -> Result<Decimals, Unread> {
    let text = std::str::from_utf8(text).map_err(|_| Unread::NotNumbers)?;
    let words: Vec<&str> = text.split('\\').take(MAX_NUMBERS).map(|word| word.trim_matches(['\0', ' '])).collect();
    if !text.contains(',') {
        let values = all(words.into_iter().map(number)).ok_or(Unread::NotNumbers)?;
        return Ok(Decimals { values, had_commas: false });
    }
    let values = if words.len() == expected {
        if may_group && words.iter().any(|word| is_grouped(word)) {
            return Err(Unread::Doubtful);
        }
        all(words.iter().map(|word| if word.contains(',') { with_point(word) } else { number(word) }))
    } else if words.len() == 1 {
        let groups: Vec<&str> = text.split(',').map(str::trim).take(MAX_NUMBERS).collect();
        let are_numbers = expected > 3 || groups.iter().any(|group| group.contains('.'));
        match groups.len() {
            n if n == expected && are_numbers => all(groups.into_iter().map(number)),
            n if n == expected.saturating_mul(2) => {
                all(groups.as_chunks::<2>().0.iter().map(|pair| with_point(&pair.join(","))))
            }
            _ => None,
        }
    } else {
        None
    };
    values.map(|values| Decimals { values, had_commas: true }).ok_or(Unread::Doubtful)
}

fn all(numbers: impl Iterator<Item = Option<f64>>) -> Option<Vec<f64>> {
    numbers.collect()
}

fn number(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value: &f64| value.is_finite())
}

/// The number of a word with one comma as its decimal point.
fn with_point(word: &str) -> Option<f64> {
    let (whole, part) = word.split_once(',')?;
    let digits = part.bytes().take_while(u8::is_ascii_digit).count();
    (digits > 0 && !whole.contains('.') && !part.contains([',', '.'])).then(|| number(&format!("{whole}.{part}")))?
}

/// Whether the comma may separate thousands: one to three digits, not zero, and then exactly three.
fn is_grouped(word: &str) -> bool {
    let Some((whole, part)) = word.trim_start_matches(['-', '+']).split_once(',') else { return false };
    let is_digits = |text: &str| text.bytes().all(|c| c.is_ascii_digit());
    (1..=3).contains(&whole.len()) && !whole.starts_with('0') && part.len() == 3 && is_digits(whole) && is_digits(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commas_are_read_where_the_number_of_values_leaves_no_doubt() {
        for (text, expected, values) in [
            ("0.35\\0.35", 2, &[0.35, 0.35][..]),
            ("0,35\\0,5", 2, &[0.35, 0.5]),
            ("0,35\\ 0.5 ", 2, &[0.35, 0.5]),
            ("-94,5\\-106,5\\8e1", 3, &[-94.5, -106.5, 80.0]),
            ("1,5E-1\\2", 2, &[0.15, 2.0]),
            ("0,35,0,5", 2, &[0.35, 0.5]),
            ("0.35,0.5", 2, &[0.35, 0.5]),
            ("1,0,0,0,1,0", 6, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
            ("1,0,0,0,0,0,0,0,1,0,0,0", 6, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
            ("1,000", 1, &[1.0]),
        ] {
            let found = read(text.as_bytes(), expected, false).unwrap();
            assert_eq!((found.values.as_slice(), found.had_commas), (values, text.contains(',')), "{text}");
        }
        for (text, expected) in [
            ("0,35", 2),
            ("1,35", 2),
            ("-94,5,-106,5,82", 3),
            ("-94,5,-106", 3),
            ("1.234,5\\0,5", 2),
            ("1,2,3\\0,5", 2),
            ("1,\\0,5", 2),
            (",\\,", 2),
            ("0,35\\0,35\\1", 2),
        ] {
            assert_eq!(read(text.as_bytes(), expected, false), Err(Unread::Doubtful), "{text}");
        }
        assert_eq!(read(b"0.35\\wide", 2, false), Err(Unread::NotNumbers));
        assert_eq!(read(b"nan\\0", 2, false), Err(Unread::NotNumbers));
    }

    #[test]
    fn a_comma_that_may_separate_thousands_is_in_doubt() {
        for text in ["-1,024", "1,000", "12,345"] {
            assert_eq!(read(text.as_bytes(), 1, true), Err(Unread::Doubtful), "{text}");
        }
        for (text, value) in [("-1024,000", -1024.0), ("0,125", 0.125), ("-1024,0", -1024.0)] {
            assert_eq!(read(text.as_bytes(), 1, true).unwrap().values, [value], "{text}");
        }
    }
}
