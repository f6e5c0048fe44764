use std::error::Error;

use axum::extract::FromRequestParts;
use axum::extract::rejection::QueryRejection;
use axum::http::request::Parts;
use serde::de::{DeserializeOwned, value};

use super::messages::{api_message, quoted_name};
use crate::http::Problem;
use prosopon_contract::{Fault, FaultKind};

/// Query parameters of a request.
#[derive(Debug)]
pub(in crate::http) struct Params<T>(pub(in crate::http) T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Params<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        match axum::extract::Query::<T>::from_request_parts(parts, state).await {
            Ok(axum::extract::Query(params)) => Ok(Self(params)),
            Err(rejection) => Err(refusal(&rejection)),
        }
    }
}

/// Number of entries of a page: 1 to 100, 20 when absent.
pub(in crate::http) fn page_length(asked: Option<u32>) -> Result<u32, Problem> {
    match asked {
        None => Ok(20),
        Some(n @ 1..=100) => Ok(n),
        Some(n) => {
            Err(Fault::new(FaultKind::MalformedRequest, format!("is {n}, allowed is 1 to 100")).at("limit").into())
        }
    }
}

/// Turns the reader's rejection into a problem that names the parameter, if the reader does.
fn refusal(rejection: &QueryRejection) -> Problem {
    let mut chain = std::iter::successors(Some(rejection as &(dyn Error + 'static)), |e| (*e).source());
    let Some(error) = chain.find_map(|e| e.downcast_ref::<serde_path_to_error::Error<value::Error>>()) else {
        return Problem::new(FaultKind::MalformedRequest, "the query cannot be read");
    };
    let (path, message) = (error.path().to_string(), error.inner().to_string());
    let name = if path == "." { quoted_name(&message).unwrap_or_default().to_owned() } else { path };
    Problem(Fault::new(FaultKind::MalformedRequest, api_message(&message)).at(&name))
}
