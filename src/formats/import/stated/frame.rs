//! Anatomical coordinate systems, named by the directions to which their axes point.

use super::words::{Token, begins_with};
use prosopon_geometry::Point;

/// Where one axis of a file points in LPS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Axis {
    /// 0 is x, 1 is y, 2 is z of LPS.
    lps: usize,
    /// Whether it points the other way.
    negative: bool,
}

/// A coordinate system whose three axes point along those of the patient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame {
    axes: [Axis; 3],
}

/// A statement about the coordinate system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameWords {
    Known(Frame),
    /// A name that says nothing about the patient's axes.
    Unknown,
}

/// Names under which a coordinate system is stated, and whether an unknown value is worth a warning.
///
/// `SPACE` is 3D Slicer's, after NRRD. The last ones have other uses too, so only a known value counts.
const KEYS: [(&[&str], bool); 12] = [
    (&["coordinate", "system"], true),
    (&["coordinatesystem"], true),
    (&["coord", "system"], true),
    (&["coordsys"], true),
    (&["coord", "sys"], true),
    (&["anatomical", "orientation"], true),
    (&["coordinate", "space"], false),
    (&["coordinates"], false),
    (&["space"], false),
    (&["frame"], false),
    (&["orientation"], false),
    (&["axes"], false),
];

/// Words that follow a code which is stated without a key, as in `RAS coordinates`.
const NOUNS: [&str; 5] = ["coordinate", "coordinates", "coords", "space", "frame"];

impl Frame {
    /// The frame named by three letters of `RLAPSI`, each axis once.
    fn from_letters(letters: [u8; 3]) -> Option<Self> {
        let axes = letters.map(|letter| match letter.to_ascii_uppercase() {
            b'L' => Some(Axis { lps: 0, negative: false }),
            b'R' => Some(Axis { lps: 0, negative: true }),
            b'P' => Some(Axis { lps: 1, negative: false }),
            b'A' => Some(Axis { lps: 1, negative: true }),
            b'S' => Some(Axis { lps: 2, negative: false }),
            b'I' => Some(Axis { lps: 2, negative: true }),
            _ => None,
        });
        let [Some(a), Some(b), Some(c)] = axes else { return None };
        let differ = a.lps != b.lps && b.lps != c.lps && c.lps != a.lps;
        differ.then_some(Self { axes: [a, b, c] })
    }

    /// The frame that the tokens name first: `RAS` or `right-anterior-superior`.
    fn named(tokens: &[Token<'_>]) -> Option<Self> {
        let first = tokens.first()?.word()?;
        if let Ok(letters) = <[u8; 3]>::try_from(first) {
            return Self::from_letters(letters);
        }
        let mut letters = [0; 3];
        for (letter, token) in letters.iter_mut().zip(0usize..) {
            *letter = direction(tokens.get(token)?.word()?)?;
        }
        Self::from_letters(letters)
    }

    /// Its three letters, for example `RAS`.
    pub(super) fn name(self) -> String {
        let letter = |axis: Axis| match (axis.lps, axis.negative) {
            (0, false) => 'L',
            (0, true) => 'R',
            (1, false) => 'P',
            (1, true) => 'A',
            (_, false) => 'S',
            (_, true) => 'I',
        };
        self.axes.map(letter).iter().collect()
    }

    pub(super) fn is_lps(self) -> bool {
        self.name() == "LPS"
    }

    /// Whether it is RAI, which ITK and ITK-SNAP call the system whose axes come *from* there: LPS.
    pub(super) fn is_rai(self) -> bool {
        self.name() == "RAI"
    }

    /// Whether the way to LPS is a mirror image.
    pub(super) fn is_left_handed(self) -> bool {
        let [a, b, c] = self.axes.map(|axis| axis.lps);
        let odd = matches!([a, b, c], [0, 2, 1] | [1, 0, 2] | [2, 1, 0]);
        self.axes.iter().fold(odd, |odd, axis| odd != axis.negative)
    }

    /// A point of this frame in LPS.
    pub(super) fn to_lps(self, p: &Point) -> Point {
        let mut lps = Point::origin();
        for (axis, &x) in self.axes.iter().zip(p.iter()) {
            if let Some(to) = lps.coords.get_mut(axis.lps) {
                // A difference, so that 0 does not become -0.
                *to = if axis.negative { 0.0 - x } else { x };
            }
        }
        lps
    }
}

/// The letter of a direction that is written out.
fn direction(word: &[u8]) -> Option<u8> {
    const WORDS: [(&str, u8); 6] = [
        ("right", b'R'),
        ("left", b'L'),
        ("anterior", b'A'),
        ("posterior", b'P'),
        ("superior", b'S'),
        ("inferior", b'I'),
    ];
    WORDS.iter().find(|(name, _)| word.eq_ignore_ascii_case(name.as_bytes())).map(|(_, letter)| *letter)
}

/// The coordinate system that is stated at the beginning of `tokens`.
pub(super) fn stated(tokens: &[Token<'_>]) -> Option<FrameWords> {
    // `RAS coordinates`.
    if let Some(frame) = Frame::named(tokens).filter(|frame| is_certain(*frame, tokens)) {
        let noun = tokens.get(1..).is_some_and(|after| NOUNS.iter().any(|noun| begins_with(after, &[noun])));
        return noun.then_some(FrameWords::Known(frame));
    }
    let (key, is_clear) = KEYS.iter().find(|(key, _)| begins_with(tokens, key))?;
    let after = tokens.get(key.len()..).unwrap_or_default();
    let (value, is) = match after {
        [Token::Is, value @ ..] => (value, true),
        value => (value, false),
    };
    if let Some(frame) = Frame::named(value) {
        let is_code = is && (*is_clear || *key == ["space"]) || is_certain(frame, value);
        return is_code.then_some(FrameWords::Known(frame));
    }
    // 3D Slicer's key in capitals is no other thing, such as a colour space.
    let is_clear = *is_clear || matches!(tokens, [Token::Word(b"SPACE"), ..]);
    (is && is_clear).then_some(FrameWords::Unknown)
}

/// Whether the words are no other thing: written out, or a common code in capitals. Others are words too (AIR, LIP, SLA).
fn is_certain(frame: Frame, words: &[Token<'_>]) -> bool {
    const COMMON: [&str; 3] = ["RAS", "LPS", "LAS"];
    let first = words.first().and_then(|t| t.word()).unwrap_or_default();
    first.len() > 3 || COMMON.contains(&frame.name().as_str()) && first.iter().all(u8::is_ascii_uppercase)
}
