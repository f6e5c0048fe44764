//! What happens around every request.

mod compression;
mod envelope;
mod hosts;
mod safety_net;

pub(super) use compression::{compression, mark_compressed};
pub(super) use envelope::{envelope, request_id};
pub(super) use hosts::check_host;
pub(super) use safety_net::safety_net;
