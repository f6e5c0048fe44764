//! The HTTP API, in process and over a real socket.
//!
//! Most tests use a fast stand-in for the numerics (`support/stand_in.rs`), because they test the service and not the
//! solver. Files that use the real numerics say so.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "test code")]

mod damage;
mod dicom;
mod edges;
#[path = "../engines/mod.rs"]
mod engines;
mod examples;
mod faults;
mod full_disk;
mod fuzz;
mod idempotency;
mod journey;
mod kill;
mod kills;
mod operate;
mod problems;
mod queue;
mod refused;
mod restart;
mod routes;
mod security;
mod sense;
mod shared;
mod support;
