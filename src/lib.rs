//! The program: the commands of `prosopon`.
//!
//! The implementation follows Wang, Yang and Gee, *Int J Med Robotics* 2009, DOI 10.1002/rcs.286; where it departs,
//! the item says so and why. Not a medical device.
//!
//! # Packages
//! An arrow points to what a package depends on; what an arrow reaches through another is left out.
//!
//! ```text
//!                     prosopon              src/            the program: commands
//!                    /        \
//!    prosopon-service          \            src/service/    sessions, jobs, HTTP, configuration
//!       |        \              \
//!  prosopon-store \       prosopon-study    src/service/store/, src/study/
//!       |          \        /     |
//! ======|===========\======/======|=======  wall: below it no HTTP, tokio, serialisation, files, network, environment or clock
//!       |       prosopon-planning |         src/planning/   CT to surfaces, cuts and paths, simulation, error maps
//!       |          /     \        |
//!       |  prosopon-field prosopon-tissue   src/field/, src/tissue/: distance fields; the mixed mesh and its elements
//!       |           |     |       |
//!       |           |     |  prosopon-formats   src/formats/  bytes to volumes and meshes, and back
//!       |           |     |     |
//!      prosopon-geometry                    src/geometry/   points, meshes, grids, volumes; cancel and progress
//! ```
//!
//! Cargo refuses an import against the arrows. `tests/layers.rs` holds the code to what Cargo cannot see: the order of the rooms of a package,
//! and what the manifests below the wall may ask for. Each room's docs state its invariants.
//!
//! Units everywhere: mm, N, MPa, s, radian; coordinates patient LPS.

pub mod cli;
pub mod demo;
