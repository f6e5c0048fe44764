//! The service: the HTTP API over sessions and jobs, and how it is configured and started.
//!
//! Rows stand behind the trait [`prosopon_store::MetaStore`] (SQLite, Postgres; memory for tests), large results behind `object_store` (files,
//! S3; memory). One process has a data directory; the queue computes one long job at a time, or as many as `parallel_jobs` says, and
//! beside them comparisons one after the other. Processes that share a database lease their jobs from it, take those of sessions that
//! they know first, and hear of each other's events. A job that is taken over goes on after its last milestone, with the same bits.
//! Rows and large results bear one name, so that nobody sweeps another's.
//!
//! Below it: [`prosopon_store`] keeps, [`prosopon_session`] knows what a patient's session holds, [`prosopon_jobs`] computes.
//! A room imports only rooms listed before it (`tests/layers.rs`): [`http`], [`config`], [`telemetry`], [`serve`].

pub mod config;
pub mod http;
pub mod serve;
pub mod telemetry;
