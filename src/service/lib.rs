//! The service: the HTTP API over sessions and jobs, its configuration and its start.
//!
//! - **Storage.** Records are stored through the trait [`prosopon_store::MetaStore`] (SQLite, Postgres; memory for tests),
//!   large results through `object_store` (files, S3; memory for tests). Database and bucket carry one common name, so that a
//!   process deletes only the blobs of its own database.
//! - **One process** uses a data directory. Its queue computes `parallel_jobs` long jobs at a time (one by default), and in
//!   parallel one comparison after another.
//! - **Several processes** on one database lease their jobs from it, prefer jobs of sessions whose data they have in memory,
//!   and receive each other's events. A process that takes over a job resumes at its last checkpoint and computes the same
//!   bits.
//!
//! The crates below: [`prosopon_store`] stores, [`prosopon_session`] defines the contents of a session, [`prosopon_jobs`]
//! computes. A module imports only modules listed before it (checked by `tests/layers.rs`): [`http`], [`config`],
//! [`telemetry`], [`serve`].

pub mod config;
pub mod http;
pub mod serve;
pub mod telemetry;
