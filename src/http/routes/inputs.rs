use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::accepted::accept;
use super::results::send_surface;
use crate::export::SurfaceView;
use crate::http::dto::{CtQuery, JobView, import_request};
use crate::http::extract::{Ids, Params};
use crate::http::result::{tag_of, tagged};
use crate::http::surface_format::SurfaceOutput;
use crate::http::upload::receive;
use crate::http::{AppState, Problem};
use crate::import::SurfaceFormat;
use crate::jobs::{CtScan, take_surface};
use crate::session::{CtDocument, FaultKind, SessionParts, SurfaceDocument, load_mesh};
use crate::store::{JobKind, PartKind, PartRecord, SessionId, now_rfc3339};

/// Times that an input is looked up again when it is replaced before it is read.
const SEND_TRIES: usize = 4;

/// Format of a stored input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum InputOutput {
    /// Binary glTF 2.0.
    Glb,
    /// Binary PLY.
    Ply,
    /// Binary STL.
    Stl,
    /// The surface report.
    Json,
}

/// Which format to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct InputQuery {
    /// Format; else Accept chooses, else GLB. `json` is the surface report.
    #[param(inline)]
    format: Option<InputOutput>,
}

/// Upload a CT
///
/// NIfTI, plain or gzipped. Streams to disk; an `import` job takes skin, skull and air from it.
#[utoipa::path(put, path = "/v1/sessions/{session}/ct", tag = "inputs",
    params(("session" = Uuid, Path), CtQuery),
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    responses((status = 202, description = "the import job", body = JobView, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn put_ct(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(query): Params<CtQuery>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let store = state.service.store();
    SessionParts::load(store, session).await?;
    let settings = query.check()?;
    let scan = CtScan::new(&state.service);
    let blob = receive(store, session, &headers, body, state.limits.max_ct_bytes, &state.limits, Some(scan)).await?;
    // A job may be reading the same CT: then its file stays.
    if store.part(session, PartKind::Ct).await?.is_some_and(|ct| ct.key == blob.sha256) {
        store.blobs().delete(&blob.key).await;
    } else {
        let document = CtDocument { sha256: blob.sha256.clone(), bytes: blob.bytes };
        let part = PartRecord {
            kind: PartKind::Ct,
            key: blob.sha256.clone(),
            blob: Some(blob.key),
            bytes: blob.bytes,
            wall_s: 0.0,
            document: serde_json::to_string(&document).unwrap_or_default(),
            updated_at: now_rfc3339(),
        };
        store.put_parts(session, &[part]).await?;
    }
    accept(&state, session, JobKind::Import, 0, &import_request(&settings, blob.sha256), None).await
}

pub(super) async fn put(
    state: &AppState,
    session: SessionId,
    kind: PartKind,
    headers: &HeaderMap,
    body: Body,
) -> Result<Json<SurfaceDocument>, Problem> {
    let store = state.service.store();
    SessionParts::load(store, session).await?;
    let upload = receive(store, session, headers, body, state.limits.max_surface_bytes, &state.limits, None).await?;
    Ok(Json(take_surface(&state.service, session, kind, upload, named_format(headers)).await?))
}

/// The format that Content-Type names, for files that do not show what they are.
fn named_format(headers: &HeaderMap) -> Option<SurfaceFormat> {
    let name = headers.get(header::CONTENT_TYPE)?.to_str().ok()?;
    match name.split(';').next()?.trim() {
        "model/stl" | "model/x.stl-binary" | "model/x.stl-ascii" | "application/sla" => Some(SurfaceFormat::Stl),
        "model/ply" | "application/ply" | "application/x-ply" => Some(SurfaceFormat::Ply),
        "model/obj" => Some(SurfaceFormat::Obj),
        _ => None,
    }
}

/// Sends an input as it is at one moment: a client that replaces it meanwhile takes its file away.
pub(super) async fn send(
    state: &AppState,
    session: SessionId,
    kind: PartKind,
    query: &InputQuery,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    for _ in 0..SEND_TRIES {
        match send_present(state, session, kind, query, headers).await {
            Err(Problem(fault)) if fault.kind == FaultKind::WrongState => {}
            sent_or_refused => return sent_or_refused,
        }
    }
    send_present(state, session, kind, query, headers).await
}

async fn send_present(
    state: &AppState,
    session: SessionId,
    kind: PartKind,
    query: &InputQuery,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let parts = SessionParts::load(state.service.store(), session).await?;
    let part = parts.require(kind)?.clone();
    let format = match query.format {
        Some(InputOutput::Json) => {
            let tag = tag_of(&[&part.key, "report"]);
            return tagged(headers, &tag, "application/json", part.document.into());
        }
        Some(InputOutput::Glb) => SurfaceOutput::Glb,
        Some(InputOutput::Ply) => SurfaceOutput::Ply,
        Some(InputOutput::Stl) => SurfaceOutput::Stl,
        None => SurfaceOutput::choose(None, headers)?,
    };
    let store = state.service.store().clone();
    let key = part.key.clone();
    send_surface(state, headers, format, &[&key], async move {
        let mesh = load_mesh(&store, &part).await?;
        Ok(move || format.write(&SurfaceView { mesh: &mesh, scalars: &[], colours: None }))
    })
    .await
}

macro_rules! surface_routes {
    ($get:ident, $put:ident, $kind:expr, $path:literal, $what:literal) => {
        #[doc = concat!("Sends the ", $what, ".")]
        #[utoipa::path(get, path = $path, tag = "inputs", summary = concat!("The ", $what), description = "As it is stored now.", params(("session" = Uuid, Path), InputQuery),
                            responses((status = 200, description = "the surface, or its report", content(
                                (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "application/ply"), (Vec<u8> = "model/stl"),
                                (SurfaceDocument = "application/json"))), (status = 304, description = "as known")))]
        pub(in crate::http) async fn $get(
            State(state): State<AppState>,
            Ids(session): Ids<SessionId>,
            Params(query): Params<InputQuery>,
            headers: HeaderMap,
        ) -> Result<Response, Problem> {
            send(&state, session, $kind, &query, &headers).await
        }

        #[doc = concat!("Takes the ", $what, ".")]
        #[utoipa::path(put, path = $path, tag = "inputs", summary = concat!("Upload the ", $what),
            description = "STL, PLY or OBJ, LPS mm. Streams to disk; takes the place of the one before. The bytes show the \
                format; where they do not, Content-Type (`model/stl`, `model/ply`, `model/obj`) says it.", params(("session" = Uuid, Path)),
                            request_body(content = Vec<u8>, content_type = "application/octet-stream"),
                            responses((status = 200, description = "the surface report", body = SurfaceDocument)))]
        pub(in crate::http) async fn $put(
            State(state): State<AppState>,
            Ids(session): Ids<SessionId>,
            headers: HeaderMap,
            body: Body,
        ) -> Result<Json<SurfaceDocument>, Problem> {
            put(&state, session, $kind, &headers, body).await
        }
    };
}

surface_routes!(get_skin, put_skin, PartKind::Skin, "/v1/sessions/{session}/skin", "skin");
surface_routes!(get_skull, put_skull, PartKind::Skull, "/v1/sessions/{session}/skull", "skull");
surface_routes!(get_target, put_target, PartKind::Target, "/v1/sessions/{session}/target", "post-operative skin");
