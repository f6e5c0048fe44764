//! The service under load: a server in a separate process, driven over HTTP as front-ends do.

mod client;
mod latencies;
mod load;
mod memory;
mod scene;
mod server;
mod study;

pub use study::ServiceStudy;
