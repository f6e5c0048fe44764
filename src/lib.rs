//! # Packages
//! A package depends only on packages above it in this table.
//!
//! | package | folder | what it has | depends on |
//! |---|---|---|---|
//! | `prosopon-geometry` | `src/geometry` | points, meshes, grids, volumes; cancel and progress | |
//! | `prosopon-formats` | `src/formats` | bytes to volumes and meshes, and back | geometry |
//! | `prosopon-field` | `src/field` | distance fields, the bone's envelope | geometry |
//! | `prosopon-tissue` | `src/tissue` | the mixed mesh and its elements | geometry |
//! | `prosopon-planning` | `src/planning` | CT to surfaces, cuts and paths, simulation, error maps | field, tissue |
//! | `prosopon-store` | `src/service/store` | rows and large results | geometry |
//! | `prosopon-contract` | `src/service/contract` | requests, documents, faults and their checks | planning, formats, store |
//! | `prosopon-session` | `src/service/session` | what a patient's session holds and needs | contract |
//! | `prosopon-jobs` | `src/service/jobs` | long jobs and short tasks on CPU pools | session |
//! | `prosopon-service` | `src/service` | HTTP, configuration, start and stop | jobs |
//! | `prosopon-study` | `src/study` | the benches behind the charts | planning, formats |
//! | `prosopon` | `src` | the program: commands | service, study |
//!
//! ```text
//! geometry <-+- formats <-----------------+
//!            +- field <---+               |
//!            +- tissue <--+- planning <---+-- study <----------------------------------+
//!            |                            |                                            |
//!            +- store <-------------------+-- contract <- session <- jobs <- service <-+- prosopon
//! ```
//!
//! Geometry, formats, field, tissue and planning know no HTTP, tokio, serialisation, files, network, environment or clock.
//! Cargo refuses an import against the arrows. `tests/layers` holds the code to what Cargo cannot see: the order of the top-level
//! modules of a package, and what the manifests of those five may ask for. Each module's docs state its invariants.
//!
//! Units everywhere: mm, N, MPa, s, radian; coordinates patient LPS.

pub mod cli;
pub mod demo;

/// Terms of code, documentation and API.
#[doc = include_str!("glossary.md")]
pub mod glossary {}

/// Where this program departs from the paper that it implements.
#[doc = include_str!("paper.md")]
pub mod paper {}
