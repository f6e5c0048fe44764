//! Engines of a shared store for tests: a private Postgres server and a bucket of an S3-compatible store.

#![allow(
    dead_code,
    unused_imports,
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "each test program uses a part of it"
)]

mod bucket;
mod cluster;

pub(crate) use bucket::{Bucket, Mood};
pub(crate) use cluster::{Cluster, fresh_database};
