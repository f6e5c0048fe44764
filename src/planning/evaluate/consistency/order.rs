//! Whether landmarks are arranged as in a head: sides, heights, and places relative to one another.

use super::known::known;
use super::pose::Pose;
use super::tuning::{MIDLINE_MM, MOST_NAMED, ORDER_MM, OUT_OF_PLACE_MM, SIDE_MM};
use prosopon_geometry::{Point, Vector, Warning};

/// Names from above downwards; each lies above all that follow it in its row.
const HEIGHTS: [&[&str]; 7] = [
    &["nasion", "nasal_bone_tip", "ans", "a_point", "b_point", "pogonion", "menton"],
    &["a_point", "incisor_upper", "b_point"],
    &["glabella", "soft_nasion", "pronasale", "labrale_superius", "stomion", "labrale_inferius", "sublabiale"],
    &["subnasale", "labrale_superius", "stomion_superius", "labrale_inferius", "soft_pogonion", "soft_menton"],
    &["sublabiale", "soft_pogonion", "soft_menton"],
    &["glabella", "soft_nasion", "pronasale", "soft_pogonion", "soft_menton"],
    &["glabella", "soft_nasion", "subnasale"],
];
/// Stems of names with sides, from above downwards.
const SIDE_HEIGHTS: [&[&str]; 2] = [&["frontomalare", "orbitale", "zygomaxillare", "molar"], &["condylion", "gonion"]];

/// Landmarks of a document with those that someone set.
#[derive(Clone, Copy)]
pub(super) struct Arranged<'a> {
    pub(super) points: &'a [(String, Point)],
    pub(super) is_given: &'a dyn Fn(&str) -> bool,
    pub(super) pose: Option<&'a Pose>,
    pub(super) midline_x_mm: Option<f64>,
}

impl Arranged<'_> {
    fn at(&self, name: &str) -> Option<Point> {
        self.points.iter().find(|(n, _)| n == name).map(|(_, p)| *p)
    }

    fn size(&self) -> f64 {
        self.pose.map_or(1.0, |pose| pose.size)
    }

    /// Landmarks on the wrong side.
    pub(super) fn exchanged(&self) -> Option<Warning> {
        let left = self.pose.map_or_else(Vector::x, Pose::left);
        let middle = self.pose.map(Pose::middle).or_else(|| Some(Point::new(self.midline_x_mm?, 0.0, 0.0)));
        let (mut all, mut wrong) = (0usize, Vec::new());
        for (name, p) in self.points.iter().filter(|(name, _)| known(name).is_some() && (self.is_given)(name)) {
            let (stem, side, other) = match (name.strip_suffix("_left"), name.strip_suffix("_right")) {
                (Some(stem), _) => (stem, 1.0, "right"),
                (_, Some(stem)) => (stem, -1.0, "left"),
                (None, None) => continue,
            };
            let opposite = self.at(&format!("{stem}_{other}"));
            let from = match opposite {
                Some(opposite) => nalgebra::center(p, &opposite),
                None => match middle {
                    Some(middle) => middle,
                    None => continue,
                },
            };
            all += 1;
            if side * (p - from).dot(&left) < -SIDE_MM * self.size() {
                wrong.push(name.as_str());
            }
        }
        if wrong.is_empty() {
            return None;
        }
        let (which, whole) = (named(&wrong), wrong.len() == all);
        let message = if whole {
            format!("left and right are exchanged, or the head is mirrored: {which} lie on the other side (left is +x)")
        } else {
            format!("left and right of these landmarks are exchanged: {which} (left is +x)")
        };
        let found = if whole || wrong.len() > 2 { Warning::unreliable } else { Warning::check };
        Some(found("landmarks-sides-exchanged", message).act("Exchange their names, or correct the points."))
    }

    /// Landmarks above others that belong above them, far from where the others place them, or a midline beside them.
    pub(super) fn out_of_order(&self) -> Option<Warning> {
        let pose = self.pose?;
        let mut wrong = self.inversions(pose);
        wrong.extend(self.out_of_place(pose));
        if let Some(x) = self.midline_x_mm {
            let off = (pose.middle_near(self.points).x - x).abs();
            if off > MIDLINE_MM * self.size() && pose.left().x.abs() > 0.9 {
                wrong.push(format!("midline_x_mm lies {off:.0} mm beside the middle of the landmarks"));
            }
        }
        let count = wrong.len();
        wrong.truncate(MOST_NAMED);
        let found = if count > 3 { Warning::unreliable } else { Warning::check };
        let message = format!("landmarks are not arranged as in a head: {}", wrong.join("; "));
        (count > 0).then(|| found("landmarks-out-of-order", message).act("Check these landmarks and their names."))
    }

    fn inversions(&self, pose: &Pose) -> Vec<String> {
        let sided = |side: &str| {
            SIDE_HEIGHTS.iter().map(|row| row.iter().map(|stem| format!("{stem}_{side}")).collect()).collect::<Vec<_>>()
        };
        let rows = HEIGHTS.iter().map(|row| row.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>());
        let rows = rows.chain(sided("left")).chain(sided("right"));
        let mut found = Vec::new();
        for row in rows {
            let there: Vec<(&String, f64)> =
                row.iter().filter_map(|name| Some((name, self.at(name)?.coords.dot(&pose.up())))).collect();
            for (i, (upper, high)) in there.iter().enumerate() {
                for (lower, low) in there.iter().skip(i + 1) {
                    let given = (self.is_given)(upper) || (self.is_given)(lower);
                    if given && low - high > ORDER_MM * pose.size {
                        found.push(format!("{lower} lies {:.0} mm above {upper}", low - high));
                    }
                }
            }
        }
        found
    }

    fn out_of_place(&self, pose: &Pose) -> Vec<String> {
        let off = |(name, p): &(String, Point)| {
            let [x, y, z] = known(name)?.reference?;
            // On the wrong side is another finding.
            let mm = [x, -x]
                .map(|x| (pose.place(&Point::new(x, y, z)) - p).norm())
                .into_iter()
                .fold(f64::INFINITY, f64::min);
            let is_wrong = (self.is_given)(name) && mm > OUT_OF_PLACE_MM * pose.size;
            is_wrong.then(|| format!("{name} lies {mm:.0} mm from where the other landmarks place it"))
        };
        self.points.iter().filter_map(off).collect()
    }
}

fn named(names: &[&str]) -> String {
    let more = names.len().saturating_sub(MOST_NAMED);
    let first = names.iter().take(MOST_NAMED).copied().collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{first} and {more} more") } else { first }
}
