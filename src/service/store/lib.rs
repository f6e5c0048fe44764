//! Persistent storage of the service: rows behind [`MetaStore`], large values behind [`Blobs`].
//!
//! Invariants: a row names a blob only after the blob is complete and synced; a blob never changes once it is written;
//! this crate knows nothing of HTTP, and of numerics only the meshes and grids that it encodes. One process at a time has a
//! data directory open.
//!
//! Rows live in SQLite (the default) or Postgres. Blobs live in files (the default) or in a bucket of an S3-compatible store: in any
//! [`object_store::ObjectStore`]. SQLite and Postgres share one SQL text (`sql`), and the tests in `conformance` hold both engines
//! to the same behaviour. Each claim of a job gives it a new fence. Every write for a running
//! job checks the fence, so a worker that has lost its job cannot write.
//!
//! Functions that open, check or copy a whole store return a boxed future. An `async fn` is compiled again in every crate that
//! awaits it, together with the database drivers below it; a boxed future is compiled once, here.

#![allow(clippy::duplicate_mod, reason = "`sql` is compiled once for each database")]

mod answer;
mod audit;
mod backup;
mod blobs;
mod changes;
#[cfg(test)]
mod conformance;
mod directory;
mod encryption;
mod error;
mod event;
mod grid_blob;
mod ids;
mod job;
mod job_state;
mod key_marks;
mod location;
mod look;
mod measured;
mod mesh_blob;
mod meta;
mod part;
mod plan;
mod postgres;
mod records;
mod restore;
mod room;
mod scrub;
mod seal;
mod session;
mod sqlite;
mod step;
mod store;
mod tenant;
mod upload;

pub use answer::{AnswerRecord, StoredAnswer};
pub use audit::{Audit, AuditEntry, AuditFault, AuditReport, SetBack, verify_audit};
pub use backup::{BackupReport, back_up};
pub use blobs::Blobs;
pub use changes::Changes;
pub use encryption::Keyring;
pub use error::StoreError;
pub use event::EventRecord;
pub use grid_blob::{decode_grid, encode_grid};
pub use ids::{JobId, OsteotomyId, PlanId, SessionId, WorkerId};
pub use job::{
    AnswerOf, Claim, Insertion, JobChange, JobFilter, JobKind, JobRecord, Lane, NewJob, QueueLimits, Supersede,
    SupersedeScope,
};
pub use job_state::JobState;
pub use location::{BucketUrl, DatabaseUrl, StoreLocation};
pub use look::{Clocks, Look};
pub use mesh_blob::{decode_mesh, encode_mesh};
pub use meta::MetaStore;
pub use part::{PartKind, PartRecord};
pub use plan::{OsteotomyRecord, PlanRecord};
pub use records::{later, now_rfc3339, rfc3339, sha256_hex};
pub use restore::restore;
pub use room::FreeRoom;
pub use scrub::{ScrubReport, scrub};
pub use session::{Owner, SessionContents, SessionRecord};
pub use step::{StepRecord, StepWritten};
pub use store::Store;
pub use tenant::TenantId;
pub use upload::{BlobInfo, Upload};
