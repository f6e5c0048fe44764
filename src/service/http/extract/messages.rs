//! Turns messages of the JSON and query readers into the API's terms: no type names, no long echoes.

/// Longest piece of a request that a message repeats, characters.
const LONGEST: usize = 60;

/// A reader's message in the API's terms. The JSON pointer gives the location.
pub(super) fn api_message(message: &str) -> String {
    let message = message.rfind(" at line ").map_or(message, |end| &message[..end]);
    for kind in ["invalid type: ", "invalid value: "] {
        if let Some((found, wanted)) = message.strip_prefix(kind).and_then(|rest| rest.rsplit_once(", expected ")) {
            return format!("expected {}, found {}", expectation(wanted), finding(found));
        }
    }
    if let Some((found, wanted)) = message.strip_prefix("invalid length ").and_then(|r| r.split_once(", expected ")) {
        return format!("expected {}, found {found} elements", expectation(wanted));
    }
    for (prefix, words) in [("unknown field `", "unknown field"), ("unknown variant `", "unknown value")] {
        if let Some((found, allowed)) = message.strip_prefix(prefix).and_then(split_name) {
            return format!("{words} `{}`, {allowed}", short(found));
        }
    }
    match message {
        "invalid float literal" => "expected a number".to_owned(),
        "invalid digit found in string"
        | "cannot parse integer from empty string"
        | "number too large to fit in target type"
        | "number too small to fit in target type" => "expected a whole number within range".to_owned(),
        _ if message.starts_with("UUID parsing failed") => "expected a UUID".to_owned(),
        _ => short(message),
    }
}

/// The first name that a message quotes: the parameter that is missing, unknown or repeated.
pub(super) fn quoted_name(message: &str) -> Option<&str> {
    message.split('`').nth(1)
}

/// Splits into the found name, which can itself contain a back-tick, and what is allowed instead.
fn split_name(text: &str) -> Option<(&str, &str)> {
    let end = text.find("`, expected ").or_else(|| text.find("`, there are no "))?;
    Some((text.get(..end)?, text.get(end + 3..)?))
}

fn expectation(wanted: &str) -> String {
    match wanted {
        "f64" | "f32" => "a number".to_owned(),
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number from 0 on".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".to_owned(),
        "a map" | "map" => "an object".to_owned(),
        "a sequence" | "sequence" => "a list".to_owned(),
        "a formatted UUID string" => "a UUID".to_owned(),
        "string or map" | "a string" => "a text".to_owned(),
        _ if wanted.starts_with("struct ") => "an object".to_owned(),
        _ => {
            let length = wanted.strip_prefix("an array of length ");
            let length = length.or_else(|| wanted.strip_suffix(" elements in sequence"));
            length.map_or_else(|| short(wanted), |n| format!("a list of {n}"))
        }
    }
}

fn finding(found: &str) -> String {
    match found {
        "map" => "an object".to_owned(),
        "sequence" => "a list".to_owned(),
        _ => {
            let kinds = ["integer ", "floating point ", "boolean ", "string "];
            short(kinds.iter().find_map(|kind| found.strip_prefix(kind)).unwrap_or(found).trim_matches('`'))
        }
    }
}

fn short(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_type_of_the_program_is_named() {
        for (message, expected) in [
            ("invalid type: string \"x\", expected f64 at line 1 column 19", "expected a number, found \"x\""),
            (
                "invalid type: integer `5`, expected struct LandmarksDocument at line 1 column 1",
                "expected an object, found 5",
            ),
            ("invalid value: integer `-1`, expected u32", "expected a whole number from 0 on, found -1"),
            ("invalid type: map, expected a sequence", "expected a list, found an object"),
            ("invalid type: null, expected struct Budget", "expected an object, found null"),
            ("invalid length 2, expected an array of length 3", "expected a list of 3, found 2 elements"),
            ("invalid length 4, expected 3 elements in sequence", "expected a list of 3, found 4 elements"),
            ("unknown field `a`b`, expected `x` or `y`", "unknown field `a`b`, expected `x` or `y`"),
            ("unknown field `a`, there are no fields", "unknown field `a`, there are no fields"),
            ("unknown variant `q`, expected one of `x`, `y`", "unknown value `q`, expected one of `x`, `y`"),
            ("missing field `plan` at line 1 column 2", "missing field `plan`"),
            ("UUID parsing failed: invalid character: found `x` at 0", "expected a UUID"),
            ("invalid float literal", "expected a number"),
        ] {
            assert_eq!(api_message(message), expected);
        }
    }

    #[test]
    fn echoes_are_short() {
        let long = "9".repeat(500);
        assert!(api_message(&format!("invalid type: string \"{long}\", expected f64")).len() < 120);
        assert!(api_message(&format!("unknown field `{long}`, expected `x`")).len() < 120);
    }
}
