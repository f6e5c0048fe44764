//! Stored form of checkpoints, from which another worker continues a job.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use prosopon_contract::{WarningDocument, from_json, to_json};
use prosopon_planning::simulate::PathCheckpoint;
use prosopon_tissue::fem::{Checkpoint, FactorOrigin, MotionNumbers};

/// A checkpoint with the time, the warnings and the inputs of the steps before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredCheckpoint {
    /// Version that wrote it; another version may compute other bits.
    version: String,
    /// Computing time of the steps up to it, s.
    pub solving_s: f64,
    /// Warnings that belong to no step, each as JSON.
    warnings: Vec<String>,
    /// Key of the target and the landmarks that the error maps of its steps depend on.
    pub compared: String,
    /// The checkpoint.
    #[serde(with = "PathCheckpointMembers")]
    pub checkpoint: PathCheckpoint,
}

/// Format that this version writes and reads: version of the program, then of the layout.
const FORMAT: &str = concat!(env!("CARGO_PKG_VERSION"), "+4");

#[derive(Serialize, Deserialize)]
#[serde(remote = "PathCheckpoint")]
struct PathCheckpointMembers {
    k: usize,
    begin: Option<Vec<(u32, MotionNumbers)>>,
    #[serde(with = "CheckpointMembers")]
    solver: Checkpoint,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Checkpoint")]
struct CheckpointMembers {
    t: f64,
    x: Vec<[f64; 3]>,
    motions: Vec<(u32, MotionNumbers)>,
    substep: f64,
    stabilised: bool,
    warned_passage: [bool; 2],
    contact_stiffness: f64,
    multipliers: Vec<(u64, f64)>,
    released: Vec<u64>,
    spring_stiffness: f64,
    spring_multipliers: Vec<f64>,
    pulled_off: Vec<u64>,
    contact_forces: Vec<(u32, [f64; 3])>,
    active: Vec<(u64, u64)>,
    double: bool,
    #[serde(with = "FactorOriginMembers")]
    factor: FactorOrigin,
    extra_iterations: u64,
    known_compliance: Vec<Vec<u32>>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "FactorOrigin")]
enum FactorOriginMembers {
    Rest,
    State { x: Vec<[f64; 3]>, projected: bool, springs: Vec<[f64; 9]> },
    Vertices(Vec<[f64; 9]>),
    Nothing,
}

impl StoredCheckpoint {
    /// A checkpoint of this version.
    ///
    /// With the time of the steps up to it (s) and the warnings that belong to no step.
    #[must_use]
    pub fn new(checkpoint: PathCheckpoint, (solving_s, warnings): (f64, &[WarningDocument]), compared: String) -> Self {
        let warnings = warnings.iter().filter_map(|w| to_json("a warning", w).ok()).collect();
        Self { version: FORMAT.to_owned(), solving_s, warnings, compared, checkpoint }
    }

    /// Warnings that belong to no step.
    #[must_use]
    pub fn warnings(&self) -> Vec<WarningDocument> {
        self.warnings.iter().filter_map(|w| from_json("a warning", w).ok()).collect()
    }

    /// Encodes the SHA-256 and the content; `None` when the content cannot be encoded.
    #[must_use]
    pub fn encode(&self) -> Option<Vec<u8>> {
        let content = postcard::to_allocvec(self).ok()?;
        Some([&Sha256::digest(&content), content.as_slice()].concat())
    }

    /// Decodes what [`StoredCheckpoint::encode`] of this version wrote; `None` for anything else.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let (sum, content) = bytes.split_first_chunk::<32>()?;
        if *Sha256::digest(content) != *sum {
            return None;
        }
        let read: Self = postcard::from_bytes(content).ok()?;
        (read.version == FORMAT).then_some(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_comes_back_bit_for_bit_and_anything_else_is_refused() {
        let x = vec![[0.1 + 0.2, -0.0, 1e-310], [1.0 / 3.0, f64::MAX, 5.0]];
        let motion = [0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8];
        let solver = Checkpoint {
            t: 0.7,
            x: x.clone(),
            motions: vec![(1, motion)],
            substep: f64::INFINITY,
            stabilised: true,
            warned_passage: [true, false],
            contact_stiffness: 0.3,
            multipliers: vec![(9, 1e-3)],
            released: vec![7],
            spring_stiffness: 0.4,
            spring_multipliers: vec![-2e-3, 0.0],
            pulled_off: vec![1],
            contact_forces: vec![(4, [1.0, 2.0, 3.0])],
            active: vec![(4, 0)],
            double: false,
            factor: FactorOrigin::State { x, projected: true, springs: vec![[0.5; 9]] },
            extra_iterations: 5,
            known_compliance: vec![vec![3, 4], vec![1]],
        };
        let checkpoint = PathCheckpoint { k: 3, begin: Some(vec![(1, motion)]), solver };
        let warning: WarningDocument = prosopon_geometry::Warning::check("gap", "a wide gap").into();
        let stored = StoredCheckpoint::new(checkpoint, (2.5, std::slice::from_ref(&warning)), "skin".to_owned());
        let bytes = stored.encode().unwrap();
        assert_eq!(StoredCheckpoint::decode(&bytes).unwrap(), stored);
        assert_eq!(StoredCheckpoint::decode(&bytes).unwrap().encode().unwrap(), bytes);
        for n in 0..bytes.len() {
            assert!(StoredCheckpoint::decode(&bytes[..n]).is_none());
            let mut damaged = bytes.clone();
            damaged[n] ^= 16;
            assert!(StoredCheckpoint::decode(&damaged).is_none(), "byte {n}");
        }
        let later = StoredCheckpoint { version: "99.0.0".to_owned(), ..stored };
        assert!(StoredCheckpoint::decode(&later.encode().unwrap()).is_none());
    }
}
