//! Named points of the skin's profile.

use std::collections::BTreeMap;

use super::super::tuning::{
    CHIN_BELOW_NOSE_MM, CHIN_DEPTH_MM, LIP_DEPTH_MM, LOWER_LIP_END, MIN_NOTCH_MM, STOMION_SHARES, SUBNASALE_SHARES,
};
use super::section::Section;
use prosopon_geometry::Point;

/// Names of the soft points, from above downwards.
pub(super) const SOFT: [&str; 9] = [
    "pronasale",
    "subnasale",
    "labrale_superius",
    "stomion_superius",
    "stomion_inferius",
    "labrale_inferius",
    "sublabiale",
    "soft_pogonion",
    "soft_menton",
];
/// The foremost point of the columella, from which the nasolabial angle is measured; reported with the others.
pub(super) const COLUMELLA: &str = "columella";

/// Finds the points on the profile; those that it does not show are left out. Returns the index of each in the section.
///
/// - `known`: points that are given, LPS mm; others are found from them
///
/// `pronasale` is the foremost point of the line, `soft_pogonion` the foremost of the chin. Between them, `subnasale` is the
/// point farthest behind the line from pronasale to the upper lip; the lips (`labrale_superius`, `labrale_inferius`) are the
/// points farthest in front of the line from subnasale to pogonion, above and below the deepest notch between them; `sublabiale`
/// is the point farthest behind the line from the lower lip to pogonion. The lips' margins (`stomion_*`) are the notch, or, where
/// the line runs into the mouth, the lowest point of the upper and the highest of the lower lip. `soft_menton` is the lowest
/// point of the chin, or, where the line runs on downwards, the one below the bony `menton`. `columella` is the point farthest
/// below the line from pronasale to subnasale.
pub(super) fn soft_points(section: &Section, known: &BTreeMap<&str, Point>) -> BTreeMap<&'static str, usize> {
    let finder = Finder { line: section.rest.iter().map(|p| [p.y, p.z]).collect(), section, known };
    finder.all()
}

struct Finder<'a> {
    /// The profile as (y, z), from above.
    line: Vec<[f64; 2]>,
    section: &'a Section,
    known: &'a BTreeMap<&'a str, Point>,
}

impl Finder<'_> {
    fn all(&self) -> BTreeMap<&'static str, usize> {
        let mut found = BTreeMap::new();
        let Some(nose) = self.given("pronasale").or_else(|| self.foremost(0, self.line.len())) else { return found };
        found.insert("pronasale", nose);
        let Some(chin) = self.given("soft_pogonion").or_else(|| self.chin(nose)).filter(|chin| *chin > nose) else {
            return found;
        };
        found.insert("soft_pogonion", chin);
        found.extend(self.menton(chin).map(|menton| ("soft_menton", menton)));
        // A first subnasale is enough to find the lips, which then place the final one.
        let Some(base) = self.extreme([nose, chin], SUBNASALE_SHARES, [nose, chin], -1.0) else { return found };
        let Some(notch) = self.notch(base, chin) else {
            found.insert("subnasale", self.given("subnasale").unwrap_or(base));
            return found;
        };
        let lip_end = self.at_share([base, chin], LOWER_LIP_END);
        let upper = self.given("labrale_superius").or_else(|| self.farthest([base, notch], [base, chin], 1.0));
        let lower = self.given("labrale_inferius").or_else(|| self.farthest([notch, lip_end], [base, chin], 1.0));
        let (upper, lower) = (upper.unwrap_or(notch), lower.unwrap_or(notch));
        found.extend([("labrale_superius", upper), ("labrale_inferius", lower)]);
        let subnasale = self.given("subnasale").or_else(|| self.farthest([nose, upper], [nose, upper], -1.0));
        let subnasale = subnasale.unwrap_or(base);
        found.insert("subnasale", subnasale);
        found.extend(self.farthest([nose, subnasale], [nose, subnasale], 1.0).map(|c| (COLUMELLA, c)));
        let fold = self.given("sublabiale").or_else(|| self.farthest([lower, chin], [lower, chin], -1.0));
        found.extend(fold.map(|fold| ("sublabiale", fold)));
        let [above, below] = self.margins(upper, notch, lower);
        found.insert("stomion_superius", self.given("stomion_superius").unwrap_or(above));
        found.insert("stomion_inferius", self.given("stomion_inferius").unwrap_or(below));
        found
    }

    fn given(&self, name: &str) -> Option<usize> {
        self.section.index_near(self.known.get(name)?)
    }

    fn foremost(&self, from: usize, to: usize) -> Option<usize> {
        (from..to.min(self.line.len())).min_by(|a, b| self.line[*a][0].total_cmp(&self.line[*b][0]))
    }

    /// The foremost point of the chin, below the fold of the lower lip.
    fn chin(&self, nose: usize) -> Option<usize> {
        let tip = self.line[nose][1];
        let is_chin = |i: &usize| (CHIN_BELOW_NOSE_MM[0]..CHIN_BELOW_NOSE_MM[1]).contains(&(tip - self.line[*i][1]));
        let range: Vec<usize> = (nose..self.line.len()).filter(is_chin).collect();
        let (first, last) = (*range.first()?, *range.last()?);
        // A lip may lie farther forward than a chin: first the chin's bulge on the way to the neck, then the fold above it.
        let bulge = self.farthest([first, last], [first, last], 1.0)?;
        let fold = self.farthest([first, bulge], [first, bulge], -1.0).unwrap_or(first);
        match self.foremost(fold, bulge + 1)? {
            foremost if foremost > fold => Some(foremost),
            // A receding chin has no foremost point of its own.
            _ => self.farthest([fold, bulge], [fold, bulge], 1.0).or(Some(bulge)),
        }
    }

    fn menton(&self, chin: usize) -> Option<usize> {
        if let Some(given) = self.given("soft_menton") {
            return Some(given);
        }
        let depth = |i: &usize| self.line[*i][0] - self.line[chin][0];
        let below: Vec<usize> = (chin..self.line.len()).take_while(|i| depth(i) < CHIN_DEPTH_MM).collect();
        let lowest = *below.iter().min_by(|a, b| self.line[**a][1].total_cmp(&self.line[**b][1]))?;
        let runs_on = below.last().is_none_or(|last| last - lowest < 2);
        let bone = self.known.get("menton").filter(|_| runs_on);
        let under = |bone: &Point| {
            let off = |i: &usize| (self.line[*i][0] - bone.y).abs();
            below.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)))
        };
        bone.and_then(under).or(Some(lowest))
    }

    /// The deepest notch between two bulges in front of the line from `base` to `chin`: its bottom.
    fn notch(&self, base: usize, chin: usize) -> Option<usize> {
        if let (Some(above), Some(below)) = (self.given("stomion_superius"), self.given("stomion_inferius")) {
            return Some(usize::midpoint(above, below));
        }
        let breaks = self.section.breaks.iter().copied().find(|b| (base..chin).contains(b));
        if let Some(begin) = breaks {
            return Some(begin);
        }
        let [from, to] = STOMION_SHARES.map(|share| self.at_share([base, chin], share));
        let end = self.at_share([base, chin], LOWER_LIP_END);
        let height = |i: usize| self.in_front(i, [base, chin]);
        let top = |from: usize, to: usize| (from..=to).map(height).fold(f64::NEG_INFINITY, f64::max);
        let depth = |i: usize| top(base, i).min(top(i, end)) - height(i);
        let deepest = (from..=to).max_by(|a, b| depth(*a).total_cmp(&depth(*b)))?;
        (depth(deepest) > MIN_NOTCH_MM).then_some(deepest)
    }

    /// Margins of the upper and the lower lip.
    fn margins(&self, upper: usize, notch: usize, lower: usize) -> [usize; 2] {
        if self.section.breaks.contains(&notch) {
            return [notch.saturating_sub(1), notch];
        }
        let shallow = |lip: usize| move |i: &usize| self.line[*i][0] - self.line[lip][0] < LIP_DEPTH_MM;
        let z = |i: &usize| self.line[*i][1];
        let above = (upper..=notch).filter(shallow(upper)).min_by(|a, b| z(a).total_cmp(&z(b)));
        let below = (notch..=lower).filter(shallow(lower)).max_by(|a, b| z(a).total_cmp(&z(b)));
        [above.unwrap_or(notch), below.unwrap_or(notch)]
    }

    /// First index from which the line lies below the share of the height from the first to the second point.
    fn at_share(&self, [from, to]: [usize; 2], share: f64) -> usize {
        let z = self.line[from][1] + share * (self.line[to][1] - self.line[from][1]);
        (from..to).find(|i| self.line[*i][1] <= z).unwrap_or(to)
    }

    /// The extreme of [`Finder::farthest`] within shares of the height.
    fn extreme(&self, ends: [usize; 2], [low, high]: [f64; 2], chord: [usize; 2], side: f64) -> Option<usize> {
        self.farthest([self.at_share(ends, low), self.at_share(ends, high)], chord, side)
    }

    /// The point within `range` farthest in front of (`side` = 1) or behind (-1) the chord; not one of the range's ends.
    fn farthest(&self, [from, to]: [usize; 2], chord: [usize; 2], side: f64) -> Option<usize> {
        let off = |i: &usize| side * self.in_front(*i, chord);
        (from + 1..to).max_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Distance of a point in front of the line from `a` down to `b`, mm.
    fn in_front(&self, i: usize, [a, b]: [usize; 2]) -> f64 {
        let (p, a, b) = (self.line[i], self.line[a], self.line[b]);
        let along = [b[0] - a[0], b[1] - a[1]];
        let length = along[0].hypot(along[1]);
        if length > 0.0 { ((p[0] - a[0]) * along[1] - (p[1] - a[1]) * along[0]) / length } else { 0.0 }
    }
}
