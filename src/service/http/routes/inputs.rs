use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::accepted::{accepted_with, store_order, stored};
use super::results::send_surface;
use crate::http::dto::{CtAccepted, CtQuery, JobView, UploadForm, import_request};
use crate::http::extract::{Ids, Params};
use crate::http::result::{tag_of, tagged};
use crate::http::surface_format::SurfaceOutput;
use crate::http::upload::{Received, receive};
use crate::http::{AppState, Problem};
use prosopon_contract::{FaultKind, SurfaceDocument};
use prosopon_formats::export::SurfaceView;
use prosopon_formats::import::SurfaceFormat;
use prosopon_jobs::{CtScan, Order, take_ct, take_surface};
use prosopon_session::{SessionParts, load_mesh};
use prosopon_store::{JobKind, PartKind, SessionId};

/// Retries when an input is replaced between its look-up and its read.
const SEND_TRIES: usize = 4;

/// Format in which to send a stored surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum InputOutput {
    /// Binary glTF 2.0.
    Glb,
    /// Binary PLY.
    Ply,
    /// Binary STL.
    Stl,
    /// VTK polygons, XML with raw appended data.
    Vtp,
    /// The surface report.
    Json,
}

/// Which format to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct InputQuery {
    /// Format of the answer; `json` is the surface report.
    ///
    /// When absent, the `Accept` header chooses, else GLB.
    #[param(inline)]
    format: Option<InputOutput>,
}

/// Upload a CT
///
/// A DICOM series as a zip archive, NIfTI (plain or gzipped), NRRD or MetaImage; a header with its voxels in other files (`.nhdr`,
/// `.mhd`, `.hdr`) comes with these in one zip archive. The upload streams to disk; an `import` job extracts skin, skull and air from it.
///
/// DICOM files may be in any order and encoding (implicit, explicit, big endian, deflated, RLE, JPEG, JPEG lossless, JPEG-LS,
/// JPEG 2000). The service stores only the voxels and their lattice, and drops everything that identifies a patient before it
/// answers. Oblique and sheared (gantry tilt) stacks keep their geometry. Unevenly spaced slices are interpolated up to
/// `max_step_mm`; larger steps are refused with the list of steps. Several acquisitions, time points or phases of one series,
/// and several volumes in one archive, are refused with a list, of which `stack` or `volume` chooses one.
///
/// The body is the file, or a form with one file (`curl -F file=@head.zip`).
#[utoipa::path(put, path = "/v1/sessions/{session}/ct", operation_id = "putCt", tag = "inputs",
    params(("session" = Uuid, Path), CtQuery),
    request_body(content((Vec<u8> = "application/octet-stream"), (UploadForm = "multipart/form-data"))),
    responses((status = 202, description = "The import job, and what was read.", body = CtAccepted, headers(("Location" = String), ("Retry-After" = u32)))))]
pub(in crate::http) async fn put_ct(
    State(state): State<AppState>,
    Ids(session): Ids<SessionId>,
    Params(query): Params<CtQuery>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let store = state.service.store();
    SessionParts::load(store, session).await?;
    let (settings, reading) = query.check()?;
    let scan = CtScan::new(&state.service);
    let upload = receive(store, session, &headers, body, state.limits.max_ct_bytes, &state.limits, Some(scan)).await?;
    let (part, ct) = take_ct(&state.service, session, upload.blob, reading).await?;
    let key = part.key.clone();
    // A job may be reading the same CT, so its file stays.
    match store.part(session, PartKind::Ct).await? {
        Some(ct) if ct.key == key && ct.document == part.document => {
            store.blobs().delete(part.blob.as_deref().unwrap_or_default()).await;
        }
        _ => store.put_parts(session, &[part]).await?,
    }
    let order = Order::new(session, JobKind::Import, stored(&import_request(&settings, key))?);
    let job = JobView::from(&store_order(&state, order, None).await?);
    Ok(accepted_with(&job, &CtAccepted { job: job.clone(), ct }))
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
    let named = named_format(&upload);
    Ok(Json(take_surface(&state.service, session, kind, upload.blob, named).await?))
}

/// The format that Content-Type or the file's name in a form names, for files whose bytes do not show their format.
fn named_format(upload: &Received) -> Option<SurfaceFormat> {
    let by_name = || match upload.file_name.as_deref()?.rsplit_once('.')?.1.to_ascii_lowercase().as_str() {
        "stl" => Some(SurfaceFormat::Stl),
        "ply" => Some(SurfaceFormat::Ply),
        "obj" => Some(SurfaceFormat::Obj),
        "vtp" => Some(SurfaceFormat::Vtp),
        _ => None,
    };
    by_media_type(upload.media_type.as_deref().unwrap_or_default()).or_else(by_name)
}

fn by_media_type(name: &str) -> Option<SurfaceFormat> {
    match name.split(';').next()?.trim() {
        "model/stl" | "model/x.stl-binary" | "model/x.stl-ascii" | "application/sla" => Some(SurfaceFormat::Stl),
        "model/ply" | "application/ply" | "application/x-ply" => Some(SurfaceFormat::Ply),
        "model/obj" => Some(SurfaceFormat::Obj),
        "application/vnd.vtk.polydata+xml" | "model/vtp" => Some(SurfaceFormat::Vtp),
        _ => None,
    }
}

/// Sends an input; retries when a client replaces it, which deletes its file, before it is read.
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
        Some(InputOutput::Vtp) => SurfaceOutput::Vtp,
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
    ($get:ident $get_id:literal, $put:ident $put_id:literal, $kind:expr, $path:literal, $what:literal) => {
        #[doc = concat!("Sends the ", $what, ".")]
        #[utoipa::path(get, path = $path, operation_id = $get_id, tag = "inputs", summary = concat!("Read the ", $what), description = "Returns the surface as it is stored now, or its report.", params(("session" = Uuid, Path), InputQuery),
                            responses((status = 200, description = "The surface or its report.", content(
                                (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "application/ply"), (Vec<u8> = "model/stl"),
                                (Vec<u8> = "application/vnd.vtk.vtp"),
                                (SurfaceDocument = "application/json"))), (status = 304, description = "Not modified.")))]
        pub(in crate::http) async fn $get(
            State(state): State<AppState>,
            Ids(session): Ids<SessionId>,
            Params(query): Params<InputQuery>,
            headers: HeaderMap,
        ) -> Result<Response, Problem> {
            send(&state, session, $kind, &query, &headers).await
        }

        #[doc = concat!("Stores the ", $what, ".")]
        #[utoipa::path(put, path = $path, operation_id = $put_id, tag = "inputs", summary = concat!("Upload the ", $what),
            description = "A surface in STL, PLY, OBJ or VTP format, LPS mm. It replaces an earlier upload. The service detects the format \
                from the bytes, else takes it from Content-Type (`model/stl`, `model/ply`, `model/obj`, `model/vtp`). The body is the file, or a form with one file (`curl -F file=@skin.stl`).", params(("session" = Uuid, Path)),
                            request_body(content((Vec<u8> = "application/octet-stream"), (UploadForm = "multipart/form-data"))),
                            responses((status = 200, description = "Report of the surface.", body = SurfaceDocument)))]
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

surface_routes!(get_skin "getSkin", put_skin "putSkin", PartKind::Skin, "/v1/sessions/{session}/skin", "skin");
surface_routes!(get_skull "getSkull", put_skull "putSkull", PartKind::Skull, "/v1/sessions/{session}/skull", "skull");
surface_routes!(get_target "getTarget", put_target "putTarget", PartKind::Target, "/v1/sessions/{session}/target", "post-operative skin");
