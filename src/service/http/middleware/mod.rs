//! Middleware around every request: ids, hosts, access, compression, headers and unexpected errors.

mod catch_errors;
mod compression;
mod guard;
mod hosts;
mod keep_room;
mod parameters;
mod request_span;
mod security;
mod whole_body;

pub(super) use catch_errors::catch_errors;
pub(super) use compression::{compression, mark_compressed};
pub(super) use guard::{Audited, guard, is_public};
pub(super) use hosts::check_host;
pub(super) use keep_room::keep_room;
pub(super) use parameters::{KnownParameters, known_parameters_only};
pub(super) use request_span::{request_id, request_span};
pub(super) use security::{cors, security_headers};
pub(super) use whole_body::take_whole_body;
