//! Middleware around every request: ids, hosts, access, compression, headers and unexpected errors.

mod compression;
mod envelope;
mod guard;
mod hosts;
mod safety_net;
mod security;

pub(super) use compression::{compression, mark_compressed};
pub(super) use envelope::{envelope, request_id};
pub(super) use guard::guard;
pub(super) use hosts::check_host;
pub(super) use safety_net::safety_net;
pub(super) use security::{cors, security_headers};
