//! The one codec of stored documents.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::fault::{Fault, FaultKind};

/// The stored form of a document.
///
/// # Errors
/// [`FaultKind::Internal`]; the log names `what` and the reason.
pub fn to_json<T: Serialize>(what: &str, document: &T) -> Result<String, Fault> {
    serde_json::to_string(document).map_err(|error| {
        tracing::error!(%error, what, "a document cannot be written");
        Fault::new(FaultKind::Internal, format!("{what} cannot be written; see the log of the service"))
    })
}

/// A document from its stored form.
///
/// # Errors
/// [`FaultKind::Internal`]; the log names `what` and the reason.
pub fn from_json<T: DeserializeOwned>(what: &str, text: &str) -> Result<T, Fault> {
    serde_json::from_str(text).map_err(|error| {
        tracing::error!(%error, what, "a stored document cannot be read");
        Fault::new(FaultKind::Internal, format!("{what} is stored but cannot be read; see the log of the service"))
    })
}
