use std::time::Duration;

use axum::extract::State;
use axum::http::{StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use time::OffsetDateTime;
use uuid::Uuid;

use crate::http::auth::Principal;
use crate::http::dto::{CreateLink, LinkView};
use crate::http::extract::Body;
use crate::http::middleware::Audited;
use crate::http::{AppState, Problem};
use prosopon_contract::Check;
use prosopon_store::rfc3339;

/// Validity of a link when the request names none, s.
const VALID_S: u32 = 300;
/// Longest validity, s.
const MAX_VALID_S: u32 = 3600;
/// Longest path, characters.
const MAX_PATH: usize = 2000;

/// Make a link that needs no token
///
/// Returns a link to one answer of a session or job, for `<img>`, `EventSource`, `<model-viewer>` and other readers that cannot
/// send a token. It is valid for minutes, for GET only, and every use is in the audit log.
#[utoipa::path(post, path = "/v1/links", operation_id = "createLink", tag = "sessions", request_body = CreateLink,
    responses((status = 201, description = "The link.", body = LinkView)))]
pub(in crate::http) async fn create(
    State(state): State<AppState>,
    principal: Principal,
    Body(request): Body<CreateLink>,
) -> Result<Response, Problem> {
    let mut check = Check::default();
    let valid_s = request.valid_s.unwrap_or(VALID_S);
    check.number("/valid_s", f64::from(valid_s), 1.0, f64::from(MAX_VALID_S));
    let target = target_of(&request.path);
    if target.is_none() {
        let detail = "is not the path of a GET below /v1/sessions/{session} or /v1/jobs/{job}; give path and query, without \
                      host and without link";
        check.fault("/path", detail);
    }
    let owner = match &target {
        Some(id) => state.service.store().owner(&id.to_string()).await?,
        None => None,
    };
    if target.is_some() && owner.is_none_or(|o| o.tenant != principal.tenant || o.deleted) {
        check.fault("/path", "names no session or job that is there");
    }
    check.finish()?;
    let expires = OffsetDateTime::now_utc() + Duration::from_secs(valid_s.into());
    let link = state.links.sign(state.service.store(), &request.path, expires, &principal.credential).await?;
    let audited = Audited { what: Some(format!("link {}", link.name)), id: target.map(|id| id.to_string()) };
    let view = LinkView { url: link.url, expires_at: rfc3339(expires) };
    Ok((StatusCode::CREATED, Extension(audited), Json(view)).into_response())
}

/// Id of the session or job in a path that can be linked to.
fn target_of(path: &str) -> Option<Uuid> {
    let uri: Uri = path.parse().ok().filter(|_| path.len() <= MAX_PATH && path.starts_with('/'))?;
    let has_link = uri.query().is_some_and(|query| query.split('&').any(|p| p.starts_with("link=")));
    // What the signature is for is what a client sends: nothing that it would leave out, such as a fragment.
    let is_exact = uri.path_and_query().is_some_and(|target| target.as_str() == path);
    let below = ["/v1/sessions/", "/v1/jobs/"].iter().find_map(|above| uri.path().strip_prefix(above))?;
    let id = below.split('/').next()?;
    id.parse().ok().filter(|_| is_exact && !has_link)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_paths_of_one_session_or_job_can_be_linked() {
        let id = "019ac0de-0000-7000-8000-000000000001";
        for path in ["/v1/jobs/ID/events", "/v1/sessions/ID", "/v1/jobs/ID/steps/1/skin?format=ply"] {
            assert!(target_of(&path.replace("ID", id)).is_some(), "{path}");
        }
        for path in [
            "/v1/jobs",
            "/v1/materials",
            "/metrics",
            "http://evil/v1/jobs/ID",
            "//evil/v1/jobs/ID",
            "/v1/jobs/ID#x",
            "/v1/jobs/ID?link=1.x",
            "/v1/jobs/other/events",
            "",
        ] {
            assert_eq!(target_of(&path.replace("ID", id)), None, "{path}");
        }
    }
}
