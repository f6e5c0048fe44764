//! Tables and words of the report's page.

use serde::Serialize;

/// Words for movement forward (towards -y), down (towards -z) and to the patient's left (+x), each with its opposite.
pub(super) const FORWARD: [&str; 2] = ["forward", "back"];
pub(super) const DOWN: [&str; 2] = ["down", "up"];
pub(super) const LEFT: [&str; 2] = ["left", "right"];

/// A table; the page leaves it out when it has no rows.
#[derive(Debug, Serialize)]
pub(super) struct Table {
    title: String,
    columns: Vec<&'static str>,
    rows: Vec<Vec<String>>,
    notes: Vec<String>,
}

impl Table {
    /// A table whose rows have one cell for each column; the first cell names the row.
    pub(super) fn new(
        title: impl Into<String>,
        columns: &[&'static str],
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        Self { title: title.into(), columns: columns.to_vec(), rows: rows.into_iter().collect(), notes: Vec::new() }
    }

    /// The table with notes below it.
    pub(super) fn with_notes(self, notes: impl IntoIterator<Item = String>) -> Self {
        Self { notes: notes.into_iter().collect(), ..self }
    }
}

/// Formats a length to 0.01 mm, without a negative zero.
pub(super) fn mm(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}

/// Formats a movement to 0.1 with the word for its direction: "6.0 forward", "1.5 mm up", "2.0° front down".
///
/// `unit` follows the number. `words` are those of positive and negative values; a movement that rounds to zero has no word.
pub(super) fn moved(value: f64, unit: &str, [positive, negative]: [&str; 2]) -> String {
    let size = format!("{:.1}", value.abs());
    match (size.as_str(), value > 0.0) {
        ("0.0", _) => format!("{size}{unit}"),
        (_, true) => format!("{size}{unit} {positive}"),
        (_, false) => format!("{size}{unit} {negative}"),
    }
}

/// Cells for the three components of a movement, mm.
pub(super) fn movement(forward_mm: f64, down_mm: f64, left_mm: f64) -> [String; 3] {
    [moved(forward_mm, "", FORWARD), moved(down_mm, "", DOWN), moved(left_mm, "", LEFT)]
}

/// A part of the face in words: `cheek_left` is "left cheek".
pub(super) fn region(name: &str) -> String {
    let words = match (name.strip_suffix("_left"), name.strip_suffix("_right")) {
        (Some(rest), _) => format!("left {rest}"),
        (None, Some(rest)) => format!("right {rest}"),
        (None, None) => name.to_owned(),
    };
    words.replace('_', " ")
}

/// A text as a sentence: first letter in upper case unless it begins a name such as `le_fort_1`, a full stop at the end.
pub(super) fn sentence(text: &str) -> String {
    let word = text.split_whitespace().next().unwrap_or_default().trim_end_matches([',', ':']);
    let mut letters = text.chars();
    let first: String = match letters.next() {
        Some(letter) if word.chars().all(char::is_alphabetic) => letter.to_uppercase().collect(),
        Some(letter) => letter.to_string(),
        None => return String::new(),
    };
    let stop = if text.ends_with(['.', '!', '?']) { "" } else { "." };
    format!("{first}{}{stop}", letters.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_moves_by_minus_zero() {
        assert_eq!([mm(-0.004), mm(0.0), mm(-0.006)], ["0.00", "0.00", "-0.01"]);
        assert_eq!(movement(-0.04, 0.0, -0.06), ["0.0", "0.0", "0.1 right"]);
    }

    #[test]
    fn movements_have_the_surgeons_words() {
        assert_eq!(movement(6.0, -1.5, 0.8), ["6.0 forward", "1.5 up", "0.8 left"]);
        assert_eq!(moved(-2.04, "°", ["front down", "front up"]), "2.0° front up");
    }

    #[test]
    fn names_and_messages_become_words() {
        assert_eq!([region("cheek_left"), region("upper_lip")], ["left cheek", "upper lip"]);
        assert_eq!(sentence("élan: 2 mm"), "Élan: 2 mm.");
        assert_eq!(["Done.", "", "le_fort_1: cut"].map(sentence), ["Done.", "", "le_fort_1: cut."]);
    }
}
