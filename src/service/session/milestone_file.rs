//! Stored form of checkpoints, from which another worker continues a job.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use prosopon_planning::simulate::PathCheckpoint;
use prosopon_tissue::fem::{Checkpoint, FactorOrigin, MotionNumbers};

/// A checkpoint with the time, the warnings and the inputs of the steps before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMilestone {
    /// Version that wrote it; another version may compute other bits.
    version: String,
    /// Computing time of the steps up to it, s.
    pub solving_s: f64,
    /// Warnings that belong to no step.
    pub warnings: Vec<String>,
    /// Key of the target and the landmarks that the error maps of its steps depend on.
    pub compared: String,
    /// The checkpoint.
    #[serde(with = "MilestoneMembers")]
    pub milestone: PathCheckpoint,
}

/// Format that this version writes and reads: version of the program, then of the layout.
const FORMAT: &str = concat!(env!("CARGO_PKG_VERSION"), "+3");

#[derive(Serialize, Deserialize)]
#[serde(remote = "PathCheckpoint")]
struct MilestoneMembers {
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
    told_passage: [bool; 2],
    contact_stiffness: f64,
    multipliers: Vec<(u64, f64)>,
    released: Vec<u64>,
    settled_forces: Vec<(u32, [f64; 3])>,
    active: Vec<(u64, u64)>,
    double: bool,
    #[serde(with = "FactorOriginMembers")]
    factor: FactorOrigin,
    lost: u64,
    known_compliance: Vec<Vec<u32>>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "FactorOrigin")]
enum FactorOriginMembers {
    Rest,
    State { x: Vec<[f64; 3]>, projected: bool },
    Vertices(Vec<[f64; 9]>),
    Nothing,
}

impl StoredMilestone {
    /// A checkpoint of this version.
    ///
    /// With the time of the steps up to it (s) and the warnings that belong to no step.
    #[must_use]
    pub fn new(milestone: PathCheckpoint, (solving_s, warnings): (f64, Vec<String>), compared: String) -> Self {
        Self { version: FORMAT.to_owned(), solving_s, warnings, compared, milestone }
    }

    /// Encodes the SHA-256 and the content; `None` when the content cannot be encoded.
    #[must_use]
    pub fn encode(&self) -> Option<Vec<u8>> {
        let content = postcard::to_allocvec(self).ok()?;
        Some([&Sha256::digest(&content), content.as_slice()].concat())
    }

    /// Decodes what [`StoredMilestone::encode`] of this version wrote; `None` for anything else.
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
    fn a_milestone_comes_back_bit_for_bit_and_anything_else_is_refused() {
        let x = vec![[0.1 + 0.2, -0.0, 1e-310], [1.0 / 3.0, f64::MAX, 5.0]];
        let motion = [0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8];
        let solver = Checkpoint {
            t: 0.7,
            x: x.clone(),
            motions: vec![(1, motion)],
            substep: f64::INFINITY,
            stabilised: true,
            told_passage: [true, false],
            contact_stiffness: 0.3,
            multipliers: vec![(9, 1e-3)],
            released: vec![7],
            settled_forces: vec![(4, [1.0, 2.0, 3.0])],
            active: vec![(4, 0)],
            double: false,
            factor: FactorOrigin::State { x, projected: true },
            lost: 5,
            known_compliance: vec![vec![3, 4], vec![1]],
        };
        let milestone = PathCheckpoint { k: 3, begin: Some(vec![(1, motion)]), solver };
        let stored = StoredMilestone::new(milestone, (2.5, vec!["told".to_owned()]), "skin".to_owned());
        let bytes = stored.encode().unwrap();
        assert_eq!(StoredMilestone::decode(&bytes).unwrap(), stored);
        assert_eq!(StoredMilestone::decode(&bytes).unwrap().encode().unwrap(), bytes);
        for n in 0..bytes.len() {
            assert!(StoredMilestone::decode(&bytes[..n]).is_none());
            let mut damaged = bytes.clone();
            damaged[n] ^= 16;
            assert!(StoredMilestone::decode(&damaged).is_none(), "byte {n}");
        }
        let later = StoredMilestone { version: "99.0.0".to_owned(), ..stored };
        assert!(StoredMilestone::decode(&later.encode().unwrap()).is_none());
    }
}
