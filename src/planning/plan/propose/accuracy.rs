//! Accuracy of proposed landmarks.

use std::collections::BTreeMap;

use super::Landmarks;
use super::tuning::UNKNOWN_MM;
use prosopon_geometry::Point;

/// Largest distance between a proposal and the known landmark over all measured heads, mm, rounded up (`prosopon bench
/// proposals` on `ct_head` and the phantoms). Points without a known landmark have the difference between the sides of
/// `ct_head` and `vtk_headsq`.
const MEASURED_MM: [(&str, f64); 20] = [
    ("a_point", 4.0),
    ("ans", 4.0),
    ("condylion", 8.0),
    ("frontomalare", 3.0),
    ("gonion", 5.0),
    ("incisor_lower", 4.0),
    ("incisor_upper", 3.0),
    ("lingula", 6.0),
    ("menton", 3.0),
    ("molar", 6.0),
    ("nasal_bone_tip", 4.0),
    ("nasion", 4.0),
    ("orbitale", 3.0),
    ("pogonion", 2.0),
    ("porion", 5.0),
    ("pronasale", 3.0),
    ("soft_menton", 5.0),
    ("soft_pogonion", 3.0),
    ("subnasale", 3.0),
    ("zygomaxillare", 5.0),
];

/// Measured accuracy of the landmark `stem`, a name without its side, mm; `None` where it was not measured.
#[must_use]
pub(crate) fn measured_accuracy_mm(stem: &str) -> Option<f64> {
    MEASURED_MM.iter().find(|(known, _)| *known == stem).map(|(_, mm)| *mm)
}

/// Accuracy of each point, mm, by name.
///
/// The measured value, or half the distance between the point and the mirror image of the other side's where that is more.
pub(super) fn within_mm(points: &BTreeMap<String, Point>, midline: f64) -> BTreeMap<String, f64> {
    let one = |(name, p): (&String, &Point)| {
        let (stem, side) = [1.0, -1.0]
            .into_iter()
            .find_map(|side| Some((name.strip_suffix(Landmarks::side_name(side))?.strip_suffix('_')?, Some(side))))
            .unwrap_or((name, None));
        let measured = measured_accuracy_mm(stem).unwrap_or(UNKNOWN_MM);
        let other = side.and_then(|side| points.get(&format!("{stem}_{}", Landmarks::side_name(-side))));
        let apart = other.map_or(0.0, |q| (p - Point::new(2.0 * midline - q.x, q.y, q.z)).norm());
        (name.clone(), measured.max((5.0 * apart).round() / 10.0))
    };
    points.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_that_disagree_are_less_sure() {
        let at = |x: f64, z: f64| Point::new(x, 3.0, z);
        let points = [
            ("menton", at(5.0, 0.0)),
            ("gonion_left", at(50.0, 4.0)),
            ("gonion_right", at(-40.0, 34.0)),
            ("other", at(0.0, 0.0)),
        ];
        let points = points.map(|(name, p)| (name.to_owned(), p)).into();
        let within = within_mm(&points, 5.0);
        let of = |name: &str| within[name];
        assert_eq!((of("menton"), of("gonion_left"), of("gonion_right"), of("other")), (3.0, 15.0, 15.0, UNKNOWN_MM));
    }
}
