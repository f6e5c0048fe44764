use std::io::Write;

use super::CommandResult;

/// Prints the description of the API.
pub(super) fn run() -> CommandResult {
    Ok(std::io::stdout().write_all(prosopon_service::http::openapi_json()?.as_bytes())?)
}
