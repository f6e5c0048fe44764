//! The HTTP API, in process and over a real socket.
//!
//! Most tests use a fast stand-in for the numerics (`support/stand_in.rs`), because they test the service and not the
//! solver. `TestApp::real` and the binary (`support/binary.rs`) use the real numerics.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr, reason = "test code")]

mod api_examples;
mod budget;
mod cancel_anywhere;
mod crash_recovery;
mod damaged_values;
mod deaf_work;
mod deformed_volume;
mod encryption;
#[path = "../engines/mod.rs"]
mod engines;
mod factor_reuse;
mod full_disk;
mod fuzz_requests;
mod hostile_requests;
mod idempotency;
mod injected_store_faults;
mod kept_results;
mod kill_nine;
mod links;
mod lost_directory;
mod openapi;
mod operator_commands;
mod problem_types;
mod python_client;
mod queue;
mod restart;
mod routes;
mod security;
mod several_processes;
mod skin_follows_jaw;
mod support;
mod turned_head;
mod wrong_frames;
