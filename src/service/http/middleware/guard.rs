use axum::extract::rejection::RawPathParamsRejection;
use axum::extract::{MatchedPath, RawPathParams, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::request_id;
use crate::http::auth::{Access, Principal, Scope};
use crate::http::{AppState, Problem};
use prosopon_session::{Fault, FaultKind};
use prosopon_store::AuditEntry;

/// Calls that only look although they have a body.
const LOOKING_POSTS: [&str; 2] = ["/v1/sessions/{session}/field/query", "/v1/materials/check"];

/// The calls that a deleted session still answers: to come back, and to go for good.
const OF_DELETED: [(Method, &str); 2] =
    [(Method::POST, "/v1/sessions/{session}/restore"), (Method::DELETE, "/v1/sessions/{session}")];

/// Calls that are not in the audit log: how work stands, and what is the same for everybody.
const NOT_AUDITED: [&str; 4] = ["/v1/jobs", "/v1/jobs/{job}", "/v1/materials", "/v1/materials/check"];

/// Lets a request through to what its sender may see and do, and writes it down. Another tenant's session or job is not there.
pub(in crate::http) async fn guard(
    State(state): State<AppState>,
    path: Option<MatchedPath>,
    params: Result<RawPathParams, RawPathParamsRejection>,
    mut request: Request,
    next: Next,
) -> Response {
    let route = path.as_ref().map_or("", MatchedPath::as_str).to_owned();
    let method = request.method().clone();
    let principal = match admit(&state, &method, &route, request.headers()).await {
        Ok(principal) => principal,
        Err(fault) => return Problem(fault).into_response(),
    };
    let id = params.as_ref().ok().and_then(named);
    let audited = route.starts_with("/v1/") && !(method == Method::GET && NOT_AUDITED.contains(&route.as_str()));
    let entry = AuditEntry {
        tenant: principal.tenant.to_string(),
        who: principal.who.clone(),
        what: format!("{method} {route}"),
        id: id.as_ref().map(|(_, id)| id.clone()),
        request_id: request_id(),
        ..AuditEntry::default()
    };
    let refused = match &id {
        Some((kind, id)) => refused(&state, &principal, (&method, &route), (kind, id)).await,
        None => None,
    };
    let response = match refused {
        Some(problem) => problem.into_response(),
        None => {
            request.extensions_mut().insert(principal);
            next.run(request).await
        }
    };
    if audited {
        let is_deletion = method == Method::DELETE && response.status() == StatusCode::NO_CONTENT;
        let made = || made_by(response.headers());
        let entry = AuditEntry { status: response.status().as_u16(), id: entry.id.clone().or_else(made), ..entry };
        state.service.note(entry, is_deletion);
    }
    response
}

/// Who sends the request, if they may make it.
async fn admit(state: &AppState, method: &Method, route: &str, headers: &HeaderMap) -> Result<Principal, Fault> {
    let Access::Tokens(authenticator) = &state.access else { return Ok(Principal::local()) };
    if is_public(route) {
        return Ok(Principal { scopes: std::iter::empty().collect(), ..Principal::local() });
    }
    let authorization = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let principal = authenticator.check(authorization).await?;
    match needed(method, route) {
        Some(scope) if !principal.scopes.allow(scope) => {
            let detail = format!("the token lacks the scope `{}`", scope.as_str());
            Err(Fault::new(FaultKind::Forbidden, detail).with("scope", scope.as_str()))
        }
        _ => Ok(principal),
    }
}

/// What holds nothing of anybody.
fn is_public(route: &str) -> bool {
    ["/livez", "/readyz", "/", "/openapi.json"].contains(&route) || route == "/docs" || route.starts_with("/docs/")
}

/// The scope that a call needs; a path that is not there needs a token and no scope.
fn needed(method: &Method, route: &str) -> Option<Scope> {
    if route == "/metrics" {
        return Some(Scope::Admin);
    }
    if route.is_empty() {
        return None;
    }
    let looks = method.is_safe() || LOOKING_POSTS.contains(&route);
    Some(if looks { Scope::Read } else { Scope::Write })
}

/// The session or job in the path.
fn named(params: &RawPathParams) -> Option<(&'static str, String)> {
    let of =
        |name: &'static str| params.iter().find(|(key, _)| *key == name).map(|(_, value)| (name, value.to_owned()));
    // In one form, so that no other spelling of an id slips by.
    let (name, id) = of("session").or_else(|| of("job"))?;
    let id: uuid::Uuid = id.parse().ok()?;
    Some((name, id.to_string()))
}

/// What an id that belongs to somebody else answers: the same, at the same moment, as one that was never there. What was deleted says so, also while
/// it can be restored.
async fn refused(
    state: &AppState,
    principal: &Principal,
    (method, route): (&Method, &str),
    (kind, id): (&str, &str),
) -> Option<Problem> {
    let is_for_deleted = || OF_DELETED.iter().any(|(m, r)| m == method && *r == route);
    match state.service.store().owner(id).await {
        Ok(Some(owner)) if owner.tenant == principal.tenant && owner.deleted && !is_for_deleted() => {
            Some(Problem::new(FaultKind::Gone, format!("{kind} {id} was deleted")))
        }
        Ok(Some(owner)) if owner.tenant == principal.tenant => None,
        Ok(_) => Some(Problem::new(FaultKind::NotFound, format!("there is no {kind} {id}"))),
        Err(error) => Some(error.into()),
    }
}

/// What the request made.
fn made_by(headers: &HeaderMap) -> Option<String> {
    let location = headers.get(header::LOCATION)?.to_str().ok()?;
    location.rsplit('/').next().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_call_needs_its_scope() {
        for (method, route, scope) in [
            (Method::GET, "/v1/sessions", Some(Scope::Read)),
            (Method::HEAD, "/v1/jobs/{job}", Some(Scope::Read)),
            (Method::POST, "/v1/sessions", Some(Scope::Write)),
            (Method::DELETE, "/v1/sessions/{session}", Some(Scope::Write)),
            (Method::PUT, "/v1/sessions/{session}/ct", Some(Scope::Write)),
            (Method::POST, "/v1/sessions/{session}/field/query", Some(Scope::Read)),
            (Method::GET, "/metrics", Some(Scope::Admin)),
            (Method::GET, "", None),
        ] {
            assert_eq!(needed(&method, route), scope, "{method} {route}");
        }
        assert!(is_public("/livez") && is_public("/docs/{*rest}") && !is_public("/metrics") && !is_public("/v1/jobs"));
    }
}
