use std::io::Write;

use super::CommandResult;

/// Prints the description.
pub(super) fn run() -> CommandResult {
    Ok(std::io::stdout().write_all(crate::http::openapi_json()?.as_bytes())?)
}
