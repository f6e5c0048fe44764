//! What survives a restart: rows in SQLite, large results as files.
//!
//! Invariants: a row names a file only after the file is complete and synced; files are never changed once written;
//! knows nothing of HTTP or numerics beyond the meshes that it encodes. Opening locks the directory for one process.

mod blobs;
mod database;
mod error;
mod events;
mod format;
mod idempotency;
mod ids;
mod job_state;
mod jobs;
mod mesh_blob;
mod parts;
mod plans;
mod records;
mod sessions;
mod steps;

pub use blobs::{BlobInfo, Blobs, Upload};
pub use database::Store;
pub use error::StoreError;
pub use events::EventRecord;
pub use idempotency::{AnswerRecord, Remembered};
pub use ids::{JobId, OsteotomyId, PlanId, SessionId};
pub use job_state::JobState;
pub(crate) use jobs::{Insertion, JobChange};
pub use jobs::{JobFilter, JobKind, JobRecord};
pub use mesh_blob::{decode_mesh, encode_mesh};
pub use parts::{PartKind, PartRecord};
pub use plans::{OsteotomyRecord, PlanRecord};
pub use records::{now_rfc3339, sha256_hex};
pub use sessions::SessionRecord;
pub use steps::StepRecord;
