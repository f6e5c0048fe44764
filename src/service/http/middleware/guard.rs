use axum::extract::rejection::RawPathParamsRejection;
use axum::extract::{MatchedPath, RawPathParams, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::request_id;
use crate::http::auth::{Access, CheckedLink, Principal, Scope};
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind};
use prosopon_store::AuditEntry;

/// POST routes that only read; they have a body, but need the scope `read`.
const READ_ONLY_POSTS: [&str; 4] = [
    "/v1/sessions/{session}/field/query",
    "/v1/sessions/{session}/osteotomies/preview",
    "/v1/materials/check",
    "/v1/links",
];

/// Routes that a deleted session still answers: restoring it, and deleting it permanently.
const ALLOWED_ON_DELETED: [(Method, &str); 2] =
    [(Method::POST, "/v1/sessions/{session}/restore"), (Method::DELETE, "/v1/sessions/{session}")];

/// GET routes without an audit entry: job states, and data that is the same for everybody.
const NOT_AUDITED: [&str; 5] = ["/v1/jobs", "/v1/jobs/{job}", "/v1/materials", "/v1/materials/check", "/v1/templates"];

/// Begin of the name of a signed link in the audit log.
const LINK: &str = "link:";

/// Further facts about a request for the audit log, as an extension of the answer.
#[derive(Debug, Clone, Default)]
pub(in crate::http) struct Audited {
    pub(in crate::http) what: Option<String>,
    /// Id of the session or job that the request concerns.
    pub(in crate::http) id: Option<String>,
}

/// Admits requests whose sender has the scope and owns the session or job, and writes the audit log.
///
/// Sessions and jobs of other tenants are reported as not found.
pub(in crate::http) async fn guard(
    State(state): State<AppState>,
    path: Option<MatchedPath>,
    params: Result<RawPathParams, RawPathParamsRejection>,
    mut request: Request,
    next: Next,
) -> Response {
    let route = path.as_ref().map_or("", MatchedPath::as_str).to_owned();
    let method = request.method().clone();
    let id = params.as_ref().ok().and_then(named);
    let admitted = match state.links.check(state.service.store(), request.uri()).await {
        Ok(Some(link)) => {
            let admitted = admit_by_link(&state, &method, id.as_ref(), &link).await;
            *request.uri_mut() = link.uri;
            admitted
        }
        Ok(None) => admit(&state, &method, &route, request.headers()).await,
        Err(fault) => Err(fault),
    };
    let principal = match admitted {
        Ok(principal) => principal,
        Err(fault) => return Problem(fault).into_response(),
    };
    let is_linked = principal.who.starts_with(LINK);
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
    let mut response = match refused {
        Some(problem) => problem.into_response(),
        None => {
            request.extensions_mut().insert(principal);
            answered(&state, request, next).await
        }
    };
    if is_linked {
        // The link is the permission: pages of any origin that have it can show what it leads to.
        response.headers_mut().insert("cross-origin-resource-policy", HeaderValue::from_static("cross-origin"));
    }
    if audited {
        let is_deletion = method == Method::DELETE && response.status() == StatusCode::NO_CONTENT;
        let made = || made_by(response.headers());
        let added = response.extensions().get::<Audited>().cloned().unwrap_or_default();
        let what = [Some(entry.what), added.what].into_iter().flatten().collect::<Vec<_>>().join(" ");
        let id = entry.id.or(added.id).or_else(made);
        let entry = AuditEntry { status: response.status().as_u16(), what, id, ..entry };
        state.service.note(entry, is_deletion);
    }
    response
}

/// The answer of the route; that the data directory is gone where it is.
///
/// What a request writes without the directory is lost, so it is not begun then, and not acknowledged. What fails has that cause.
async fn answered(state: &AppState, request: Request, next: Next) -> Response {
    let gone = || state.service.store().check_directory().err().map(|gone| Problem::from(gone).into_response());
    let writes = !request.method().is_safe();
    if writes && let Some(refused) = gone() {
        return refused;
    }
    let response = next.run(request).await;
    let is_in_doubt = response.status().is_server_error() || writes && response.status().is_success();
    if is_in_doubt && let Some(refused) = gone() {
        return refused;
    }
    response
}

/// The reader of a signed link: the tenant of the session or job in its path.
async fn admit_by_link(
    state: &AppState,
    method: &Method,
    id: Option<&(&'static str, String)>,
    link: &CheckedLink,
) -> Result<Principal, Fault> {
    if !method.is_safe() {
        return Err(Fault::new(FaultKind::Forbidden, "a link allows nothing but GET; send a bearer token"));
    }
    let owner = match id {
        Some((_, id)) => state.service.store().owner(id).await?,
        None => None,
    };
    let reader = Principal {
        who: format!("{LINK}{}", link.name),
        scopes: std::iter::once(Scope::Read).collect(),
        credential: link.maker.clone(),
        ..Principal::local()
    };
    // What is gone has no owner.
    let Some(owner) = owner else { return Ok(reader) };
    let reader = Principal { tenant: owner.tenant, ..reader };
    if state.access.still_admits(&reader) {
        return Ok(reader);
    }
    let detail = "the key that made the link was removed or changed; ask for a new link with POST /v1/links";
    Err(Fault::new(FaultKind::Unauthenticated, detail))
}

/// The sender of the request, if it has the required scope.
async fn admit(state: &AppState, method: &Method, route: &str, headers: &HeaderMap) -> Result<Principal, Fault> {
    let Access::Tokens(authenticator) = &state.access else { return Ok(Principal::local()) };
    if is_public(route) {
        return Ok(Principal { scopes: std::iter::empty().collect(), ..Principal::local() });
    }
    let authorization = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let principal = authenticator.check(authorization)?;
    match needed(method, route) {
        Some(scope) if !principal.scopes.allow(scope) => {
            let detail = format!("the token lacks the scope `{}`; use a token with that scope", scope.as_str());
            Err(Fault::new(FaultKind::Forbidden, detail).with("scope", scope.as_str()))
        }
        _ => Ok(principal),
    }
}

/// Whether a route needs no token, because it shows nothing of any tenant.
pub(in crate::http) fn is_public(route: &str) -> bool {
    ["/livez", "/readyz", "/", "/assets/{name}", "/icon.svg", "/problems/{kind}", "/openapi.json", "/docs"]
        .contains(&route)
        || route.starts_with("/docs/")
}

/// The scope that a route needs. An unknown path needs a token, but no scope.
fn needed(method: &Method, route: &str) -> Option<Scope> {
    if route == "/metrics" {
        return Some(Scope::Admin);
    }
    if route.is_empty() {
        return None;
    }
    let looks = method.is_safe() || READ_ONLY_POSTS.contains(&route);
    Some(if looks { Scope::Read } else { Scope::Write })
}

/// The session or job in the path.
fn named(params: &RawPathParams) -> Option<(&'static str, String)> {
    let of =
        |name: &'static str| params.iter().find(|(key, _)| *key == name).map(|(_, value)| (name, value.to_owned()));
    // Parsing brings every spelling of an id into one form.
    let (name, id) = of("session").or_else(|| of("job"))?;
    let id: uuid::Uuid = id.parse().ok()?;
    Some((name, id.to_string()))
}

/// The problem for an id that the sender cannot use.
///
/// An id of another tenant gets the same answer, after the same time, as an id that never existed. A deleted object answers
/// gone, even while it can be restored.
async fn refused(
    state: &AppState,
    principal: &Principal,
    (method, route): (&Method, &str),
    (kind, id): (&str, &str),
) -> Option<Problem> {
    let is_for_deleted = || ALLOWED_ON_DELETED.iter().any(|(m, r)| m == method && *r == route);
    match state.service.store().owner(id).await {
        Ok(Some(owner)) if owner.tenant == principal.tenant && owner.deleted && !is_for_deleted() => {
            Some(Problem::new(FaultKind::Gone, format!("{kind} {id} was deleted")))
        }
        Ok(Some(owner)) if owner.tenant == principal.tenant => None,
        Ok(_) => Some(Problem::new(FaultKind::NotFound, format!("there is no {kind} {id}"))),
        Err(error) => Some(error.into()),
    }
}

/// Id of the object that the request created, from the Location header.
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
