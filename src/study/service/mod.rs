//! The service under load: a server as a program of its own, driven over HTTP as front-ends would.

mod client;
mod latencies;
mod load;
mod memory;
mod scene;
mod server;
mod study;

pub use study::ServiceStudy;
