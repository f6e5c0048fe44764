use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use axum::extract::{MatchedPath, Query, Request, State};
use axum::http::Uri;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use utoipa::openapi::path::{Parameter, ParameterIn};
use utoipa::openapi::{OpenApi, RefOr};

use crate::http::Problem;
use prosopon_contract::{Fault, FaultKind};

/// Names of the query parameters of each GET, PUT, POST and DELETE below `/v1/`, by method and route.
#[derive(Debug, Clone)]
pub(in crate::http) struct KnownParameters(Arc<BTreeMap<(&'static str, String), BTreeSet<String>>>);

impl KnownParameters {
    /// The parameters that the OpenAPI document names.
    pub(in crate::http) fn of(api: OpenApi) -> Self {
        let mut known = BTreeMap::new();
        for (path, item) in api.paths.paths.into_iter().filter(|(path, _)| path.starts_with("/v1/")) {
            let operations = [("GET", item.get), ("PUT", item.put), ("POST", item.post), ("DELETE", item.delete)];
            for (method, operation) in operations {
                let Some(operation) = operation else { continue };
                let in_query = |parameter| match parameter {
                    RefOr::T(Parameter { parameter_in: ParameterIn::Query, name, .. }) => Some(name),
                    RefOr::T(_) | RefOr::Ref(_) => None,
                };
                let names = operation.parameters.unwrap_or_default().into_iter().filter_map(in_query).collect();
                known.insert((method, path.clone()), names);
            }
        }
        Self(Arc::new(known))
    }

    /// The fault of a query with a parameter that the route does not know.
    fn check(&self, method: &str, route: &str, uri: &Uri) -> Option<Fault> {
        let method = if method == "HEAD" { "GET" } else { method };
        let (_, known) = self.0.iter().find(|((m, r), _)| *m == method && r == route)?;
        let Query(given) = Query::<Vec<(String, String)>>::try_from_uri(uri).ok()?;
        let (name, _) = given.into_iter().find(|(name, _)| !known.contains(name))?;
        let names: Vec<String> = known.iter().map(|name| format!("`{name}`")).collect();
        let detail = match names.as_slice() {
            [] => format!("unknown parameter `{name}`; this request has none"),
            names => format!("unknown parameter `{name}`, allowed are {}", names.join(", ")),
        };
        Some(Fault::new(FaultKind::MalformedRequest, detail).at(&name))
    }
}

/// Refuses query parameters that the route does not have: a misspelt one would be left out in silence.
pub(in crate::http) async fn known_parameters_only(
    State(known): State<KnownParameters>,
    path: Option<MatchedPath>,
    request: Request,
    next: Next,
) -> Response {
    let route = path.as_ref().map_or("", MatchedPath::as_str);
    match known.check(request.method().as_str(), route, request.uri()) {
        Some(fault) => Problem(fault).into_response(),
        None => next.run(request).await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_route_takes_the_parameters_of_its_description() {
        let known = KnownParameters::of(crate::http::openapi());
        let check = |method, route, uri: &str| {
            known.check(method, route, &uri.parse().unwrap()).map(|fault| fault.errors[0].pointer.clone())
        };
        assert_eq!(check("GET", "/v1/jobs", "/v1/jobs?limit=3&status=done"), None);
        assert_eq!(check("HEAD", "/v1/jobs", "/v1/jobs?limit=3&stat%75z=done"), Some("/statuz".to_owned()));
        assert_eq!(check("GET", "/v1/sessions/{session}", "/v1/sessions/7?a"), Some("/a".to_owned()));
        assert_eq!(check("GET", "/livez", "/livez?a=b"), None);
    }
}
