use super::Case;
use prosopon_planning::plan::Cut;
use prosopon_store::sha256_hex;

/// Key (SHA-256, hexadecimal) of something that is made from `parts`, in order.
#[must_use]
pub fn key_of(parts: &[&str]) -> String {
    let mut text = String::new();
    for part in parts {
        // The length distinguishes ("ab", "c") from ("a", "bc").
        text.push_str(&format!("{}:{part};", part.len()));
    }
    sha256_hex(text.as_bytes())
}

/// Key of the cut bone.
///
/// The debug form prints the shortest decimals, which distinguish all bits of the numbers.
pub(super) fn bone_key(case: &Case, cuts: &[Cut]) -> String {
    // The landmarks say where the teeth are, on which tissue glides.
    let teeth = format!("{:?} {:?}", case.midline_x_mm, case.occlusal_z_mm);
    key_of(&[&case.key, &format!("{cuts:?}"), &teeth])
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Point, TriMesh};
    use prosopon_planning::simulate::{Anatomy, FieldsSettings};
    use std::sync::Arc;

    /// The same cuts at other teeth are other bone: tissue glides elsewhere.
    #[test]
    fn cut_bone_has_another_key_when_the_landmarks_of_the_teeth_change() {
        let surface =
            TriMesh::new(vec![Point::origin(), Point::new(1.0, 0.0, 0.0), Point::new(0.0, 1.0, 0.0)], vec![[0, 1, 2]]);
        let skin = surface.unwrap();
        let anatomy = Anatomy {
            skull: skin.clone(),
            skin,
            air: None,
            soft_tissue: None,
            landmarks: Vec::new(),
            midline_x_mm: None,
        };
        let case = |midline_x_mm, occlusal_z_mm| Case {
            anatomy: Arc::new(anatomy.clone()),
            fields: FieldsSettings::default(),
            key: "k".to_owned(),
            midline_x_mm,
            occlusal_z_mm,
            unconfirmed: Vec::new(),
            frame: None,
        };
        let first = bone_key(&case(Some(0.0), Some(-40.0)), &[]);
        assert_eq!(first, bone_key(&case(Some(0.0), Some(-40.0)), &[]));
        for other in [case(Some(0.0), Some(-41.0)), case(Some(0.5), Some(-40.0)), case(None, None)] {
            assert_ne!(first, bone_key(&other, &[]));
        }
    }

    #[test]
    fn where_parts_end_matters() {
        assert_ne!(key_of(&["ab", "c"]), key_of(&["a", "bc"]));
        assert_eq!(key_of(&["a", "b"]), key_of(&["a", "b"]));
    }
}
