//! Prosopon predicts the face after the jaw is cut and moved.
//!
//! The implementation follows Wang, Yang and Gee, *Int J Med Robotics* 2009, DOI 10.1002/rcs.286; where it departs,
//! the item says so and why. Not a medical device.
//!
//! # Rooms
//! A room imports only rooms listed before it; `tests/layers.rs` holds the code to that. Each room's docs state its invariants.
//!
//! - [`control`]: cancel and progress. [`geometry`]: points, meshes, implicit solids, surface reports.
//! - [`import`]: untrusted bytes (DICOM, NIfTI, NRRD, MetaImage; STL, PLY, OBJ, VTP, VTU) to volumes and surfaces. [`export`]: them to bytes.
//! - [`surface`]: volumes and grids to surfaces. [`phantom`]: the analytic head.
//! - [`field`]: smooth signed distance fields and the bone's outer envelope. [`mesh`]: the mixed mesh.
//! - [`fem`]: elements, materials, contact, Newton. [`plan`]: osteotomies and paths. [`evaluate`]: error maps and pictures.
//! - [`simulate`]: from surfaces and a plan to steps of deformed skin.
//!
//! So far synchronous and pure: no HTTP, tokio, serialisation, files, network, environment or clock. Behind this wall:
//!
//! - [`store`], [`session`], [`jobs`], [`http`]: records, what a session may do, the queue, the API. Rows stand behind the trait
//!   [`store::MetaStore`] (SQLite, Postgres; memory for tests), large results behind `object_store` (files, S3; memory). One process has a
//!   data directory; the queue computes one long job at a time, or as many as `parallel_jobs` says, and beside them comparisons one
//!   after the other. Processes that share a database lease their jobs from it, take those of sessions that they know
//!   first, and hear of each other's events. A job that is taken over goes on after its last milestone, with the same bits. Rows and large results bear one name, so that nobody sweeps another's.
//! - [`mod@bench`]: the studies behind the charts, and CTs as files.
//! - [`trace`]: how a trace goes from a request to its job.
//! - [`config`], [`telemetry`], [`serve`], [`demo`], [`cli`]: the program.
//!
//! Units everywhere: mm, N, MPa, s, radian; coordinates patient LPS.

pub mod control;
pub mod evaluate;
pub mod export;
pub mod fem;
pub mod field;
pub mod geometry;
pub mod import;
pub mod mesh;
pub mod phantom;
pub mod plan;
pub mod simulate;
pub mod surface;
// ---- wall ----
pub mod bench;
pub mod demo;
pub mod http;
pub mod jobs;
pub mod session;
pub mod store;
pub mod trace;
// ---- the program ----
pub mod cli;
pub mod config;
pub mod serve;
pub mod telemetry;
