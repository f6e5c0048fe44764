//! Words of a comment, for finding a coordinate system or a unit in it.

/// Part of a comment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Token<'a> {
    /// A run of ASCII letters and digits.
    Word(&'a [u8]),
    /// `=` or `:`.
    Is,
    /// Any other character that ends a phrase, such as a full stop or a zero byte.
    Break,
}

impl<'a> Token<'a> {
    /// The word, if it is one.
    pub(super) fn word(self) -> Option<&'a [u8]> {
        match self {
            Self::Word(word) => Some(word),
            Self::Is | Self::Break => None,
        }
    }
}

/// The tokens of a comment. Spaces, quotes, `_`, `-` and `+` only separate words.
pub(super) fn tokens(comment: &[u8]) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let mut rest = comment;
    while let Some((&first, tail)) = rest.split_first() {
        if first.is_ascii_alphanumeric() {
            let end = rest.iter().position(|c| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
            let (word, after) = rest.split_at(end);
            found.push(Token::Word(word));
            rest = after;
            continue;
        }
        match first {
            b' ' | b'\t' | b'_' | b'-' | b'+' | b'"' | b'\'' => {}
            b'=' | b':' => found.push(Token::Is),
            _ => found.push(Token::Break),
        }
        rest = tail;
    }
    found
}

/// Whether `tokens` begin with these words, in any case.
pub(super) fn begins_with(tokens: &[Token<'_>], words: &[&str]) -> bool {
    let mut tokens = tokens.iter();
    words.iter().all(|word| {
        tokens.next().and_then(|t| t.word()).is_some_and(|found| found.eq_ignore_ascii_case(word.as_bytes()))
    })
}
