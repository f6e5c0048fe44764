//! What survives a restart: rows behind [`MetaStore`], large results behind [`Blobs`].
//!
//! Invariants: a row names a file only after the file is complete and synced; files are never changed once written;
//! knows nothing of HTTP or numerics beyond the meshes that it encodes. Opening locks the directory for one process.
//!
//! Rows are in SQLite (the default), Postgres or memory; large results in files (the default), a bucket of an S3-compatible store, or
//! memory: whatever is an [`object_store::ObjectStore`]. `conformance` holds all to the same behaviour. SQLite and Postgres share one text
//! of SQL (`sql`). The fence that every write of a running job checks keeps out a worker whose job was given to another.
//!
//! What opens, checks or copies a whole store returns a boxed future. An `async fn` is compiled again in every package that awaits
//! it, with the database drivers below it; a boxed one is compiled here only.

#![allow(clippy::duplicate_mod, reason = "`sql` is compiled once for each database")]

mod answer;
mod audit;
mod backup;
mod blobs;
mod changes;
#[cfg(test)]
mod conformance;
mod directory;
mod error;
mod event;
mod grid_blob;
mod ids;
mod job;
mod job_state;
mod memory;
mod mesh_blob;
mod meta;
mod part;
mod place;
mod plan;
mod postgres;
mod records;
mod scrub;
mod seal;
mod session;
mod sqlite;
mod step;
mod store;
mod tenant;

pub use answer::{AnswerRecord, Remembered};
pub use audit::{Audit, AuditEntry, AuditFault, AuditReport, verify_audit};
pub use backup::{BackupReport, back_up, restore};
pub use blobs::{BlobInfo, Blobs, Upload};
pub use changes::Changes;
pub use error::StoreError;
pub use event::EventRecord;
pub use grid_blob::{decode_grid, encode_grid};
pub use ids::{JobId, OsteotomyId, PlanId, SessionId, WorkerId};
pub use job::{
    AnswerOf, Claim, Insertion, JobChange, JobFilter, JobKind, JobRecord, Lane, NewJob, QueueLimits, Supersede,
};
pub use job_state::JobState;
pub use mesh_blob::{decode_mesh, encode_mesh};
pub use meta::MetaStore;
pub use part::{PartKind, PartRecord};
pub use place::{BucketUrl, DatabaseUrl, Places};
pub use plan::{OsteotomyRecord, PlanRecord};
pub use records::{later, now_rfc3339, sha256_hex};
pub use scrub::{ScrubReport, scrub};
pub use session::{Owner, SessionContents, SessionRecord};
pub use step::{StepRecord, StepWritten};
pub use store::Store;
pub use tenant::TenantId;
