//! Coordinates in messages, when a computation ran in another frame than that of its caller.

use super::{Motion, Point, Vector};

/// The text with each triple of coordinates, `(x, y, z)`, moved; a triple after `by ` is a shift, which is turned only.
///
/// Messages state places like this; each number keeps its decimals.
///
/// ```
/// use prosopon_geometry::{Motion, moved_places};
///
/// let up = Motion::translation(0.0, 0.0, 100.0);
/// let text = "tissue near (1.0, -2.5, 3.0) mm, shifted by (0, 0, 4) mm (two of it)";
/// assert_eq!(moved_places(text, &up), "tissue near (1.0, -2.5, 103.0) mm, shifted by (0, 0, 4) mm (two of it)");
/// ```
#[must_use]
pub fn moved_places(text: &str, motion: &Motion) -> String {
    let mut moved = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(open) = rest.find('(') {
        let (before, from) = rest.split_at(open);
        moved.push_str(before);
        let triple = from.find(')').and_then(|close| Some((close, from.get(1..close)?)));
        let Some((close, (values, decimals))) = triple.and_then(|(close, inner)| Some((close, triple_of(inner)?)))
        else {
            moved.push('(');
            rest = from.get(1..).unwrap_or_default();
            continue;
        };
        let there = if before.ends_with("by ") {
            motion.rotation * Vector::from(values)
        } else {
            (motion * Point::from(values)).coords
        };
        // A number that rounds to zero has no sign.
        let round = |value: f64| {
            let scale = 10f64.powi(decimals as i32);
            (value * scale).round() / scale + 0.0
        };
        let [x, y, z] = <[f64; 3]>::from(there).map(round);
        moved.push_str(&format!("({x:.decimals$}, {y:.decimals$}, {z:.decimals$})"));
        rest = from.get(close + 1..).unwrap_or_default();
    }
    moved.push_str(rest);
    moved
}

/// Three numbers with a comma and a space between them, and the decimals of the first.
fn triple_of(text: &str) -> Option<([f64; 3], usize)> {
    let mut parts = text.split(", ");
    let [x, y, z] = [parts.next()?, parts.next()?, parts.next()?];
    let is_number = |part: &str| part.chars().all(|c| c.is_ascii_digit() || c == '.' || c == '-');
    if parts.next().is_some() || ![x, y, z].into_iter().all(is_number) {
        return None;
    }
    let decimals = x.split_once('.').map_or(0, |(_, fraction)| fraction.len());
    Some(([x.parse().ok()?, y.parse().ok()?, z.parse().ok()?], decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_triples_of_numbers_move() {
        let motion = Motion::new(Vector::new(10.0, 0.0, 0.0), Vector::z() * std::f64::consts::FRAC_PI_2);
        let at = |text: &str| moved_places(text, &motion);
        assert_eq!(at("near (1.00, 2.00, 3.00) mm"), "near (8.00, 1.00, 3.00) mm");
        assert_eq!(at("at (1, 2, 3) and (0, 0, 0) mm"), "at (8, 1, 3) and (10, 0, 0) mm");
        assert_eq!(at("moved by (1.0, 0.0, 0.0) mm"), "moved by (0.0, 1.0, 0.0) mm");
        for text in ["(left is +x)", "(1, 2)", "(1, 2, 3, 4)", "(1, 2, c)", "a (b", "(", "(é)", "(1, 2, 3", ""] {
            assert_eq!(at(text), text);
        }
        assert_eq!(at("(see (1, 2, 3))"), "(see (8, 1, 3))");
    }
}
