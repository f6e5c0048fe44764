//! Units of length.

use super::words::{Token, begins_with};

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Unit {
    /// Name in the plural.
    pub(super) name: &'static str,
    /// Its length, mm.
    pub(super) mm: f64,
}

/// A statement about the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum UnitWords {
    Known(Unit),
    Unknown,
}

/// Units and what they are called. A short name that is also a word counts only after `=` or `:`.
const UNITS: [(Unit, &[&str], &[&str]); 6] = [
    (Unit { name: "millimetres", mm: 1.0 }, &["mm", "millimeter", "millimeters", "millimetre", "millimetres"], &[]),
    (Unit { name: "centimetres", mm: 10.0 }, &["cm", "centimeter", "centimeters", "centimetre", "centimetres"], &[]),
    (Unit { name: "metres", mm: 1000.0 }, &["meter", "meters", "metre", "metres"], &["m"]),
    (Unit { name: "inches", mm: 25.4 }, &["inch", "inches"], &["in"]),
    (Unit { name: "feet", mm: 304.8 }, &["foot", "feet"], &["ft"]),
    (
        Unit { name: "micrometres", mm: 0.001 },
        &["micrometer", "micrometers", "micrometre", "micrometres", "micron", "microns"],
        &["um"],
    ),
];

const KEYS: [&[&str]; 4] = [&["unit"], &["units"], &["lengthunit"], &["unitoflength"]];

fn unit(word: &[u8], short_too: bool) -> Option<Unit> {
    let is_among = |names: &[&str]| names.iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes()));
    let found = UNITS.iter().find(|(_, names, short)| is_among(names) || short_too && is_among(short));
    found.map(|(unit, ..)| *unit)
}

/// The unit that is stated at the beginning of `tokens`: `UNIT=mm`, `units: m`, `units are metres`, `uses centimeters as units`.
pub(super) fn stated(tokens: &[Token<'_>]) -> Option<UnitWords> {
    let word = tokens.first()?.word()?;
    if let Some(unit) = unit(word, false)
        && tokens
            .get(1..)
            .is_some_and(|after| begins_with(after, &["as", "units"]) || begins_with(after, &["as", "unit"]))
    {
        return Some(UnitWords::Known(unit));
    }
    let key = KEYS.iter().find(|key| begins_with(tokens, key))?;
    let after = tokens.get(key.len()..).unwrap_or_default();
    let (after, is) = match after {
        [Token::Is, after @ ..] => (after, true),
        after => (after, false),
    };
    // `units in mm`, `units are metres`.
    let filler = |w: &[u8]| [&b"in"[..], b"is", b"are"].iter().any(|f| w.eq_ignore_ascii_case(f));
    let after = match after {
        [Token::Word(first), value @ ..]
            if filler(first) && matches!(value, [Token::Word(w), ..] if unit(w, true).is_some()) =>
        {
            value
        }
        after => after,
    };
    let value = after.first().and_then(|t| t.word())?;
    match unit(value, is || after.len() == 1) {
        Some(unit) => Some(UnitWords::Known(unit)),
        None => (is && !value.iter().all(u8::is_ascii_digit)).then_some(UnitWords::Unknown),
    }
}
