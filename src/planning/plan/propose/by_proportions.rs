use super::tuning::{LE_FORT_1_BELOW_NOSE_MM, NOSE_STRIP_MM, OCCLUSAL_BELOW_NOSE_MM};
use crate::phantom::Landmarks;
use prosopon_geometry::{Point, TriMesh, Vector};

/// Landmarks estimated from the skin alone, to be checked by a person.
///
/// The foremost point near the middle is the tip of the nose (`pronasale`, the only point); the planes lie at an adult's usual
/// distances below it.
#[must_use]
pub(in super::super) fn propose_by_proportions(skin: &TriMesh) -> Landmarks {
    let center = skin.bounds().center();
    let middle = skin.positions().iter().filter(|p| (p.x - center.x).abs() < NOSE_STRIP_MM);
    let nose = middle.fold(center, |best, p| if p.y < best.y { *p } else { best });
    let plane = Point::new(nose.x, center.y, nose.z - LE_FORT_1_BELOW_NOSE_MM);
    Landmarks {
        points: vec![("pronasale".to_owned(), nose)],
        midline_x_mm: nose.x,
        occlusal_plane_z_mm: nose.z - OCCLUSAL_BELOW_NOSE_MM,
        le_fort_1_plane: (plane, Vector::z()),
    }
}
