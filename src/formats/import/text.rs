//! Words of a text file.

/// Iterates over words separated by white space and counts lines, which end with LF, CR LF or CR.
#[derive(Debug)]
pub(super) struct Words<'a> {
    rest: &'a [u8],
    line: u64,
}

impl<'a> Words<'a> {
    /// Words of `bytes`, whose first line has number `line`.
    pub(super) fn new(bytes: &'a [u8], line: u64) -> Self {
        Self { rest: bytes, line }
    }

    /// The next word on this or a later line.
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        while let Some((first, tail)) = self.rest.split_first() {
            if !first.is_ascii_whitespace() {
                break;
            }
            let ends = *first == b'\n' || *first == b'\r' && tail.first() != Some(&b'\n');
            self.line = self.line.saturating_add(u64::from(ends));
            self.rest = tail;
        }
        let end = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
        let (word, tail) = self.rest.split_at(end);
        self.rest = tail;
        (!word.is_empty()).then_some(word)
    }

    /// The next word as a number.
    pub(super) fn next_number(&mut self) -> Option<f64> {
        number(self.next()?)
    }

    /// Takes the rest of the line.
    pub(super) fn rest_of_line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&c| is_line_end(c)).unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        line
    }

    /// Whether the rest of the line holds no word.
    pub(super) fn line_is_done(&self) -> bool {
        self.rest.iter().find(|c| is_line_end(**c) || !c.is_ascii_whitespace()).is_none_or(|c| is_line_end(*c))
    }

    /// Number of bytes left, without leading and trailing white space.
    pub(super) fn bytes_left(&self) -> usize {
        self.rest.trim_ascii().len()
    }

    /// Line number of the last word.
    pub(super) fn line(&self) -> u64 {
        self.line
    }
}

fn is_line_end(c: u8) -> bool {
    c == b'\n' || c == b'\r'
}

/// The bytes without the mark of UTF-8 that some editors put at the beginning of a text.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// The number that `word` spells; it may be NaN or infinite.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_know_their_line() {
        let mut words = Words::new(b" a b\r\nskip this\n -1.5e1", 1);
        assert_eq!((words.next(), words.line()), (Some(&b"a"[..]), 1));
        assert_eq!((words.next(), words.line()), (Some(&b"b"[..]), 1));
        assert_eq!((words.next(), words.line()), (Some(&b"skip"[..]), 2));
        assert_eq!(words.rest_of_line(), b" this");
        assert_eq!((words.next_number(), words.line()), (Some(-15.0), 3));
        assert_eq!(words.next(), None);
    }
}
