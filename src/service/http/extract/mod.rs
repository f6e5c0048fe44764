//! Extractors whose refusals are problems.

mod creating;
mod json;
mod landmarks;
mod messages;
mod path;
mod query;
mod strict;

pub(super) use creating::{Answering, CreateBody, RepeatableBody, mark_replayed};
pub(super) use json::Body;
pub use json::{JsonFault, strict_json, strict_value};
pub(super) use landmarks::LandmarksBody;
pub(super) use path::Ids;
pub(super) use query::{Params, page_length};
