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
    use super::key_of;

    #[test]
    fn where_parts_end_matters() {
        assert_ne!(key_of(&["ab", "c"]), key_of(&["a", "bc"]));
        assert_eq!(key_of(&["a", "b"]), key_of(&["a", "b"]));
    }
}
