//! Intermediate results as bytes, so that another process, or this one after a restart, need not build them again.

use std::sync::OnceLock;

use prosopon_geometry::Flat;
use sha2::{Digest, Sha256};

/// A kind of intermediate result that may be kept beyond the process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kept {
    /// The distance fields of a case, under the case's key.
    Fields,
    /// A tissue mesh, under its request's key.
    Tissue,
}

type Program = [u8; 32];

/// The fastest level of zstd; higher ones save another hundredth.
const LEVEL: i32 = 1;

/// Hash of the running program; `None` where it cannot be read.
///
/// Another program may build other bits from the same inputs, and lays out the bytes of [`Flat`] in its own way.
fn program() -> Option<&'static Program> {
    static PROGRAM: OnceLock<Option<Program>> = OnceLock::new();
    // The link leads to the program that runs, even if another one has taken its place on disk.
    let read = || std::fs::File::open("/proc/self/exe").ok();
    let hash = |mut file: std::fs::File| {
        let mut hasher = Sha256::new();
        std::io::copy(&mut file, &mut hasher).ok().map(|_| hasher.finalize().into())
    };
    PROGRAM.get_or_init(|| read().and_then(hash)).as_ref()
}

/// The bytes of a result: the hash of the program, then, compressed, its kind, its key and itself; `None` where the program has no
/// hash.
pub(super) fn to_bytes<T: Flat>(kept: Kept, key: &str, result: &T) -> Option<Vec<u8>> {
    let (mut bytes, mut flat) = (program()?.to_vec(), Vec::new());
    (kept as u8).write(&mut flat);
    key.to_owned().write(&mut flat);
    result.write(&mut flat);
    // The fields of a head take half the room then, and a fifth of a second.
    zstd::stream::copy_encode(flat.as_slice(), &mut bytes, LEVEL).ok()?;
    Some(bytes)
}

/// The result that this program wrote under `key`; `None` for other bytes.
pub(super) fn from_bytes<T: Flat>(kept: Kept, key: &str, bytes: &[u8]) -> Option<T> {
    let flat = zstd::stream::decode_all(bytes.strip_prefix(program()?.as_slice())?).ok()?;
    let mut rest = flat.as_slice();
    let is_it = u8::read(&mut rest)? == kept as u8 && String::read(&mut rest)? == key;
    T::read(&mut rest).filter(|_| is_it && rest.is_empty())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use prosopon_contract::Solid;
    use prosopon_formats::import::Limits;
    use prosopon_geometry::Point;
    use prosopon_geometry::control::Control;
    use prosopon_planning::phantom;
    use prosopon_planning::simulate::{Anatomy, FieldsSettings, Mouth, TissueSettings};

    use super::*;
    use crate::{Case, Engine, Numerics, TissueRequest};

    /// What one process builds another one takes over, bit for bit, and builds nothing itself.
    #[test]
    fn fields_and_a_mesh_with_a_mouth_are_the_same_after_recall() {
        let head = phantom::head_with_mouth();
        let surface = |solid| phantom::surface_of(solid, &head.bounds(), 3.0).unwrap();
        let anatomy = Anatomy {
            skin: surface(head.skin.as_ref()),
            skull: surface(head.skull.as_ref()),
            air: None,
            soft_tissue: None,
            landmarks: head.landmarks.points.clone(),
            midline_x_mm: Some(0.0),
        };
        let case = Case {
            anatomy: Arc::new(anatomy),
            fields: FieldsSettings::default(),
            key: "field".to_owned(),
            midline_x_mm: Some(0.0),
            occlusal_z_mm: None,
            unconfirmed: Vec::new(),
            frame: None,
        };
        let mut settings = TissueSettings { mouth: Mouth::Auto, ..TissueSettings::default() };
        settings.mesh.edge_mm = 9.0;
        let request = TissueRequest { settings, cuts: None, key: "mesh".to_owned() };
        let control = Control::new();
        let [first, second] = [(); 2].map(|()| Numerics::new(Limits::default()));
        let built = first.tissue(&case, &request, &control).unwrap();
        for (kept, key) in [(Kept::Fields, "field"), (Kept::Tissue, "mesh")] {
            let bytes = first.bytes_of(kept, key).unwrap();
            assert!(!second.has(kept, key) && second.recall(kept, key, &bytes) && second.has(kept, key));
            assert!(second.bytes_of(kept, key).unwrap() == bytes, "{kept:?}");
            assert!(!second.recall(kept, key, &bytes[..bytes.len() / 2]));
        }
        assert_eq!(second.tissue(&case, &request, &control).unwrap(), built);
        let points = [Point::new(0.0, -70.0, 0.0), Point::new(30.0, -20.0, 40.0)];
        for solid in [Solid::Skin, Solid::Bone] {
            let [a, b] = [&first, &second].map(|numerics| numerics.distances(&case, solid, &points, &control).unwrap());
            assert_eq!(a, b);
        }
    }

    #[test]
    fn only_whole_bytes_of_this_program_and_key_are_read() {
        let bytes = to_bytes(Kept::Fields, "a", &vec![1.5, -2.0]).unwrap();
        let read = |bytes: &[u8]| from_bytes::<Vec<f64>>(Kept::Fields, "a", bytes);
        assert_eq!(read(&bytes), Some(vec![1.5, -2.0]));
        assert_eq!(read(&bytes[..bytes.len() - 1]), None);
        assert_eq!(read(&[&bytes[..], &[0]].concat()), None);
        assert_eq!(from_bytes::<Vec<f64>>(Kept::Fields, "b", &bytes), None);
        assert_eq!(from_bytes::<Vec<f64>>(Kept::Tissue, "a", &bytes), None);
        let mut of_another = bytes;
        of_another[0] ^= 1;
        assert_eq!(read(&of_another), None);
    }
}
