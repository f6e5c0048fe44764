use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use serde::de::DeserializeOwned;

use crate::http::Problem;
use prosopon_contract::FaultKind;

/// Ids and numbers of the path. One that cannot be parsed gets the answer not-found.
#[derive(Debug)]
pub(in crate::http) struct Ids<T>(pub(in crate::http) T);

impl<S: Send + Sync, T: DeserializeOwned + Send> FromRequestParts<S> for Ids<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match axum::extract::Path::<T>::from_request_parts(parts, state).await {
            Ok(axum::extract::Path(ids)) => Ok(Self(ids)),
            Err(_) => Err(Problem::new(FaultKind::NotFound, "the path contains something that is not an id or number")),
        }
    }
}
