//! Changes of frame, side and unit by which files of one head often differ.

use std::fmt;

use super::tuning::LIKELY_SIZES;
use prosopon_geometry::{Point, Vector};

/// A likely mistake: signs of the axes, and a factor of the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    signs: [f64; 3],
    /// Factor of the unit.
    pub(super) factor: f64,
}

/// Signs of the axes with what they stand for, the likeliest first.
const SIGNS: [([f64; 3], &str); 5] = [
    ([1.0, 1.0, 1.0], ""),
    ([-1.0, -1.0, 1.0], "turned by 180° about z (x and y with the other sign, as between RAS and LPS)"),
    ([-1.0, 1.0, 1.0], "mirrored in x (left and right exchanged)"),
    ([1.0, -1.0, 1.0], "mirrored in y (front and back exchanged)"),
    ([1.0, 1.0, -1.0], "mirrored in z (top and bottom exchanged)"),
];
/// Factors to mm with the unit, and the inverse factors.
const UNITS: [(f64, &str); 7] = [
    (1.0, ""),
    (10.0, "multiplied by 10 (cm instead of mm)"),
    (25.4, "multiplied by 25.4 (inches instead of mm)"),
    (1000.0, "multiplied by 1000 (metres instead of mm)"),
    (0.1, "divided by 10"),
    (1.0 / 25.4, "divided by 25.4"),
    (0.001, "divided by 1000 (µm instead of mm)"),
];

impl Change {
    /// No change.
    pub(super) const NONE: Self = Self { signs: [1.0; 3], factor: 1.0 };

    /// All changes but none, with those of the signs alone first.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let units = UNITS.iter().flat_map(|(factor, _)| SIGNS.iter().map(|(signs, _)| (*factor, *signs)));
        // A mirror image in another unit is so rare that a fit would more likely be chance.
        let likely = |c: &Self| c.factor == 1.0 || c.signs[0] == c.signs[1] && c.signs[2] > 0.0;
        units.map(|(factor, signs)| Self { signs, factor }).skip(1).filter(likely)
    }

    /// Changes after which something `size` times as large as the other has a likely size.
    pub(super) fn of_size(size: f64) -> impl Iterator<Item = Self> {
        Self::all().filter(move |c| c.is_likely(size))
    }

    /// Whether something `size` times as large as the other has a likely size after it.
    pub(super) fn is_likely(&self, size: f64) -> bool {
        (LIKELY_SIZES[0]..LIKELY_SIZES[1]).contains(&(size * self.factor))
    }

    /// The change of unit by which `size`, relative to a likely one, becomes 1 within a third.
    pub(super) fn of_unit(size: f64) -> Option<Self> {
        let fits = |factor: &f64| *factor != 1.0 && (0.66..1.5).contains(&(size * factor));
        let factor = UNITS.iter().map(|(factor, _)| *factor).find(fits)?;
        Some(Self { factor, ..Self::NONE })
    }

    /// Whether x and y change their signs, and z does not.
    pub(super) fn is_half_turn(&self) -> bool {
        self.signs == [-1.0, -1.0, 1.0]
    }

    /// The point after the change.
    pub(super) fn apply(&self, p: &Point) -> Point {
        Point::from(p.coords.component_mul(&Vector::from(self.signs)) * self.factor)
    }

    /// The points after the change.
    pub(super) fn of(&self, points: &[Point]) -> Vec<Point> {
        points.iter().map(|p| self.apply(p)).collect()
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let signs = SIGNS.iter().find(|(signs, _)| *signs == self.signs).map_or("", |(_, text)| text);
        let unit = UNITS.iter().find(|(factor, _)| *factor == self.factor).map_or("", |(_, text)| text);
        let both = if signs.is_empty() || unit.is_empty() { "" } else { " and " };
        write!(f, "{signs}{both}{unit}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_has_a_text_and_the_simple_ones_come_first() {
        let texts: Vec<String> = Change::all().map(|c| c.to_string()).collect();
        assert!(texts.iter().all(|t| !t.is_empty()), "{texts:?}");
        assert!(texts[0].contains("RAS") && texts[1].contains("mirrored in x"), "{texts:?}");
        assert_eq!(texts.len(), 4 + 6 * 2);
        let p = Point::new(1.0, 2.0, 3.0);
        assert_eq!(Change::all().next().unwrap().apply(&p), Point::new(-1.0, -2.0, 3.0));
    }

    #[test]
    fn sizes_choose_units() {
        let unit = |size: f64| Change::of_unit(size).map(|c| c.factor);
        for (size, factor) in [(0.1, 10.0), (0.0011, 1000.0), (1.0 / 25.4, 25.4), (9.0, 0.1), (25.4, 1.0 / 25.4)] {
            assert_eq!(unit(size), Some(factor), "{size}");
        }
        assert_eq!((unit(1.0), unit(3.0)), (None, None));
        assert!(Change::of_size(1.0).all(|c| c.factor == 1.0));
        assert!(Change::of_size(0.1).all(|c| c.factor > 1.0));
    }
}
