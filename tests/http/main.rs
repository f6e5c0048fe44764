//! The HTTP API, in process and over a real socket.
//!
//! Most tests use a fast stand-in for the numerics (`support/stand_in.rs`), because they test the service and not the
//! solver. `support/binary.rs`, `compare.rs` and `reuse.rs` use the real numerics.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "test code")]

mod bone;
mod compare;
mod damage;
mod dicom;
mod edges;
#[path = "../engines/mod.rs"]
mod engines;
mod events;
mod examples;
mod faults;
mod full_disk;
mod fuzz;
mod health;
mod idempotency;
mod inputs;
mod jobs;
mod journey;
mod kill;
mod kills;
mod materials;
mod meshes;
mod operate;
mod problems;
mod queue;
mod refused;
mod restart;
mod results;
mod reuse;
mod security;
mod sense;
mod sessions;
mod shared;
mod support;
mod tissue;
