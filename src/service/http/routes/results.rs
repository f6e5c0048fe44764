use std::future::Future;

use axum::body::Bytes;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use super::on_demand::{ErrorQuery, compared};
use super::step_surface::{load, load_upright, upright};
use crate::http::dto::{ErrorView, finite};
use crate::http::extract::{Ids, Params};
use crate::http::result::{not_modified, tag_of, tagged};
use crate::http::surface_format::SurfaceOutput;
use crate::http::{AppState, Problem};
use prosopon_contract::{ErrorDocument, Fault, FaultKind, WarningDocument, from_json};
use prosopon_formats::export::SurfaceView;
use prosopon_geometry::{TriMesh, Vector};
use prosopon_jobs::{Service, SkinFrame, rest_of};
use prosopon_planning::evaluate::{Layer, View, moved_along, render_panels as draw};
use prosopon_session::error_sheet;
use prosopon_store::{JobId, JobRecord, StepRecord};

/// Format of a surface to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct FormatQuery {
    /// Format of the answer. When absent, the `Accept` header chooses, else GLB.
    #[param(inline)]
    pub(super) format: Option<SurfaceOutput>,
}

/// Format of a step's skin, and the reference of its error.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct SkinQuery {
    /// Format of the answer. When absent, the `Accept` header chooses, else GLB.
    #[param(inline)]
    format: Option<SurfaceOutput>,
    /// Id of a job whose step at the same path parameter replaces the reference of the stored error map.
    #[param(value_type = Option<Uuid>)]
    reference: Option<JobId>,
    /// Whether to register the prediction on the skin that the plan does not move; false when absent.
    register: Option<bool>,
}

/// Sends a surface, written on the CPU pool; answers 304 if the client has the tagged result.
pub(super) async fn send_surface<W>(
    state: &AppState,
    headers: &HeaderMap,
    format: SurfaceOutput,
    key: &[&str],
    load: impl Future<Output = Result<W, Problem>>,
) -> Result<Response, Problem>
where
    W: FnOnce() -> Vec<u8> + Send + 'static,
{
    let mut parts = key.to_vec();
    parts.push(format.as_str());
    let tag = tag_of(&parts);
    if let Some(known) = not_modified(headers, &tag) {
        return Ok(known);
    }
    let write = load.await?;
    let bytes = state.service.compute(move |_, _| Ok(write())).await?;
    tagged(headers, &tag, format.media_type(), Bytes::from(bytes))
}

/// A direction in which skin moves.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum Movement {
    /// Forward; backward movement is negative.
    #[default]
    Forward,
    /// Up; downward movement is negative.
    Up,
    /// To the patient's left; movement to the right is negative.
    Left,
}

impl Movement {
    /// Name in a picture, and direction in LPS.
    fn direction(self) -> (&'static str, Vector) {
        match self {
            Self::Forward => ("moved forward", -Vector::y()),
            Self::Up => ("moved up", Vector::z()),
            Self::Left => ("moved to the left", Vector::x()),
        }
    }
}

/// Options for a picture of a step.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct PictureQuery {
    /// Direction of the movement that the colours show; `forward` when absent.
    #[param(inline)]
    movement: Option<Movement>,
}

/// A solve, and its skin at rest: step 0.
async fn at_rest(service: &Service, id: JobId) -> Result<(JobRecord, TriMesh), Problem> {
    let job = service.job(id).await?;
    let rest = rest_of(service, &job).await?;
    Ok((job, rest))
}

async fn find(service: &Service, id: JobId, k: u32) -> Result<(JobRecord, StepRecord), Problem> {
    let job = service.job(id).await?;
    if k == 0 || k > job.steps {
        let detail = match (job.steps, k) {
            (0, _) => format!("a job of kind {} has no steps; name a solve", job.kind.as_str()),
            (_, 0) => "step 0 is the skin at rest, which has no error; name a step from 1 on".to_owned(),
            (steps, _) => format!("the job has no step {k}, only 0 (at rest) to {steps}"),
        };
        return Err(Problem::new(FaultKind::NotFound, detail));
    }
    match service.store().step(id, k).await? {
        Some(step) => Ok((job, step)),
        None => {
            let fault = Fault::new(FaultKind::NotReady, format!("step {k} is not available; the job is {}", job.state));
            Err(fault.with("job_status", job.state.as_str()).into())
        }
    }
}

/// Read the triangles of all frames
///
/// Returns three little-endian u32 vertex numbers per triangle, as `api/frames.md` describes.
#[utoipa::path(get, path = "/v1/jobs/{job}/topology", operation_id = "getTopology", tag = "results", params(("job" = Uuid, Path)),
    responses((status = 200, description = "The triangles.", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn topology(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(id).await?;
    let rest = rest_of(&state.service, &job).await?;
    let tag = tag_of(&[job.rest_blob.as_deref().unwrap_or_default(), "topology"]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let bytes: Vec<u8> = rest.triangles().iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    tagged(&headers, &tag, "application/octet-stream", bytes.into())
}

/// Read the deformed skin of a step
///
/// Returns the surface with `displacement_mm` of every vertex and, if the step has an error map, `error_mm`. Step 0 is the skin
/// at rest, without an error.
#[utoipa::path(get, path = "/v1/jobs/{job}/steps/{k}/skin", operation_id = "getStepSkin", tag = "results",
    params(("job" = Uuid, Path), ("k" = u32, Path), SkinQuery),
    responses((status = 200, description = "The surface.", content(
        (Vec<u8> = "model/gltf-binary"), (Vec<u8> = "application/ply"), (Vec<u8> = "model/stl"),
        (Vec<u8> = "application/vnd.vtk.vtp"))),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn skin(
    State(state): State<AppState>,
    Ids((id, k)): Ids<(JobId, u32)>,
    Params(query): Params<SkinQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let format = SurfaceOutput::choose(query.format, &headers)?;
    let query = ErrorQuery { reference: query.reference, register: query.register };
    if k == 0 {
        if query.is_asked() {
            let detail = "step 0 is the skin at rest, which has no error; name a step from 1 on";
            return Err(Problem::new(FaultKind::NotFound, detail));
        }
        let (job, rest) = at_rest(&state.service, id).await?;
        let key = [job.rest_blob.as_deref().unwrap_or_default(), "step 0"];
        return send_surface(&state, &headers, format, &key, async {
            Ok(move || {
                let frame = SkinFrame::at_rest(&rest);
                let scalars = [("displacement_mm", frame.displacement_mm.as_slice())];
                format.write(&SurfaceView { mesh: &rest, scalars: &scalars, colours: None })
            })
        })
        .await;
    }
    let (job, step) = find(&state.service, id, k).await?;
    let key = query.key(&state.service, &job, &step).await?;
    send_surface(&state, &headers, format, &[&key], async {
        let (_, mesh, mut frame) = load(&state.service, &job, &step).await?;
        if query.is_asked() {
            frame.error_mm = Some(compared(&state.service, &job, &step, &query).await?.error_mm);
        }
        Ok(move || {
            let mut scalars = vec![("displacement_mm", frame.displacement_mm.as_slice())];
            scalars.extend(frame.error_mm.as_deref().map(|e| ("error_mm", e)));
            format.write(&SurfaceView { mesh: &mesh, scalars: &scalars, colours: None })
        })
    })
    .await
}

/// Numbers of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum FrameNumbers {
    /// Positions and scalars as f32, mm.
    #[default]
    Float32,
    /// Displacements and error as i16, in steps of a micrometre; a twelfth of the bytes, compressed.
    Int16,
}

/// Form of a frame.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct FrameQuery {
    /// Numbers of the frame; `float32` when absent.
    #[param(inline)]
    numbers: Option<FrameNumbers>,
}

/// Read the frame of a step
///
/// Returns the deformed skin as little-endian f32: positions, then scalars, as `api/frames.md` describes. Step 0 is the skin at
/// rest. `numbers=int16` gives displacements from rest in 16 bits.
#[utoipa::path(get, path = "/v1/jobs/{job}/steps/{k}/frame", operation_id = "getStepFrame", tag = "results",
    params(("job" = Uuid, Path), ("k" = u32, Path), FrameQuery),
    responses((status = 200, description = "The frame.", body = Vec<u8>, content_type = "application/octet-stream",
            headers(("Prosopon-Scalars" = String, description = "Names of the scalars, with commas between."))),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn frame(
    State(state): State<AppState>,
    Ids((id, k)): Ids<(JobId, u32)>,
    Params(query): Params<FrameQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let is_short = query.numbers == Some(FrameNumbers::Int16);
    let (tag, bytes, scalars) = if k == 0 {
        let (job, rest) = at_rest(&state.service, id).await?;
        let frame = SkinFrame::at_rest(&rest);
        let name = if is_short { "short frame 0" } else { "frame 0" };
        let bytes = if is_short { frame.encode_short(&rest) } else { frame.encode() };
        (tag_of(&[job.rest_blob.as_deref().unwrap_or_default(), name]), bytes.into(), "displacement_mm")
    } else {
        let (job, step) = find(&state.service, id, k).await?;
        let scalars = if step.error.is_some() { "displacement_mm,error_mm" } else { "displacement_mm" };
        // The answer in floats is the stored bytes, so their hash is the tag.
        let tag = if is_short { tag_of(&[&step.sha256, "short"]) } else { format!("\"{}\"", step.sha256) };
        if let Some(known) = not_modified(&headers, &tag) {
            return Ok(known);
        }
        let bytes = if is_short {
            let (rest, _, frame) = load(&state.service, &job, &step).await?;
            frame.encode_short(&rest).into()
        } else {
            state.service.store().blobs().get(&step.blob).await?
        };
        (tag, bytes, scalars)
    };
    let mut response = tagged(&headers, &tag, "application/octet-stream", bytes)?;
    response.headers_mut().insert("prosopon-scalars", axum::http::HeaderValue::from_static(scalars));
    Ok(response)
}

/// Read the deformed volume
///
/// Returns a VTU file. Its points are at rest; `displacement_mm` moves them. On points also `attachment`, as it was in the solve, and
/// on cells `tissue` and `volume_ratio`, with the numbers of an uploaded tissue mesh. Only jobs with the output `tissue` have it.
#[utoipa::path(get, path = "/v1/jobs/{job}/tissue", operation_id = "getDeformedTissue", tag = "results", params(("job" = Uuid, Path)),
    responses((status = 200, description = "The volume.", body = Vec<u8>, content_type = "application/vnd.vtk.vtu"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn tissue(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let job = state.service.job(id).await?;
    let Some(blob) = &job.tissue_blob else {
        let detail = format!("no volume is available: the job is {} (ask for the output tissue)", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()).into());
    };
    let tag = tag_of(&[blob, "tissue"]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    tagged(&headers, &tag, "application/vnd.vtk.vtu", state.service.store().blobs().get(blob).await?)
}

fn error_of(job: &JobRecord, step: &StepRecord) -> Result<ErrorDocument, Problem> {
    let Some(error) = &step.error else {
        let detail = "the step has no error map: the session had no target and the job no reference_job with a step at this \
                      path parameter, or the job did not ask for the output error";
        let warnings: Vec<serde_json::Value> =
            job.warnings.iter().map(|w| serde_json::json!(WarningDocument::from_row(w))).collect();
        let fault = Fault::new(FaultKind::NoReference, detail).with("warnings", warnings);
        return Err(fault.into());
    };
    Ok(from_json("the error map", error)?)
}

/// Read the signed error map of a step
///
/// Returns statistics, a histogram and the value of every vertex, negative where the prediction lies behind the reference. By
/// default this is the map that the job stored. `reference` compares with another job and `register` registers first; the
/// service computes both on demand.
#[utoipa::path(get, path = "/v1/jobs/{job}/steps/{k}/error", operation_id = "getStepError", tag = "results",
    params(("job" = Uuid, Path), ("k" = u32, Path), ErrorQuery),
    responses((status = 200, description = "The error map.", body = ErrorView), (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn error(
    State(state): State<AppState>,
    Ids((id, k)): Ids<(JobId, u32)>,
    Params(query): Params<ErrorQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (job, step) = find(&state.service, id, k).await?;
    let key = query.key(&state.service, &job, &step).await?;
    let tag = tag_of(&[&key, "error"]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let view = if query.is_asked() {
        let found = compared(&state.service, &job, &step, &query).await?;
        let correspondence_mm = found.correspondence_mm.map(finite);
        ErrorView { content: found.document, values_mm: finite(found.error_mm), correspondence_mm }
    } else {
        let content = error_of(&job, &step)?;
        let (_, _, frame) = load(&state.service, &job, &step).await?;
        ErrorView { content, values_mm: finite(frame.error_mm.unwrap_or_default()), correspondence_mm: None }
    };
    tagged(&headers, &tag, "application/json", serde_json::to_vec(&view).unwrap_or_default().into())
}

/// Draw the error map of a step
///
/// Returns one PNG sheet with front, side and three-quarter views in colours from -3 mm (blue) to 3 mm (red), a histogram and
/// statistics. The patient's left is on the right of the front view.
#[utoipa::path(get, path = "/v1/jobs/{job}/steps/{k}/error.png", operation_id = "getStepErrorPicture", tag = "results",
    params(("job" = Uuid, Path), ("k" = u32, Path), ErrorQuery),
    responses((status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn error_picture(
    State(state): State<AppState>,
    Ids((id, k)): Ids<(JobId, u32)>,
    Params(query): Params<ErrorQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (job, step) = find(&state.service, id, k).await?;
    let key = query.key(&state.service, &job, &step).await?;
    let tag = tag_of(&[&key, "error.png", when_of(&job)]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let png = if query.is_asked() {
        let found = compared(&state.service, &job, &step, &query).await?;
        let mesh = found.mesh.moved(&upright(&job));
        let png = state.service.compute(move |_, _| Ok(error_sheet(&mesh, &found.error_mm, &found.document)));
        png.await?
    } else {
        draw_error(&state.service, &job, &step).await?
    };
    tagged(&headers, &tag, "image/png", png.into())
}

/// Draw a step
///
/// Returns a PNG picture of the skin before and after. Colours show the movement in one direction: red forward (or up, or to
/// the left), blue the opposite.
#[utoipa::path(get, path = "/v1/jobs/{job}/steps/{k}/picture.png", operation_id = "getStepPicture", tag = "results",
    params(("job" = Uuid, Path), ("k" = u32, Path), PictureQuery),
    responses((status = 200, description = "The picture.", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn picture(
    State(state): State<AppState>,
    Ids((id, k)): Ids<(JobId, u32)>,
    Params(query): Params<PictureQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (job, step) = find(&state.service, id, k).await?;
    let movement = query.movement.unwrap_or_default();
    let tag = tag_of(&[&step.sha256, "picture.png", movement.direction().0, when_of(&job)]);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let png = draw_step(&state.service, &job, &step, movement).await?;
    tagged(&headers, &tag, "image/png", png.into())
}

/// Whether the frame of the head, in which pictures are drawn, is known: part of their tags.
fn when_of(job: &JobRecord) -> &'static str {
    if job.report.is_some() { "upright" } else { "as scanned" }
}

/// Front view of the face, turned slightly so that the profile shows.
fn view() -> View {
    View { direction: Vector::new(-0.55, 0.8, -0.1).normalize(), up: Vector::z(), size_px: [1560, 620] }
}

async fn draw_error(service: &Service, job: &JobRecord, step: &StepRecord) -> Result<Vec<u8>, Problem> {
    let document = error_of(job, step)?;
    let (_, mesh, frame) = load_upright(service, job, step).await?;
    let png = service.compute(move |_, _| Ok(error_sheet(&mesh, &frame.error_mm.unwrap_or_default(), &document)));
    Ok(png.await?)
}

async fn draw_step(
    service: &Service,
    job: &JobRecord,
    step: &StepRecord,
    movement: Movement,
) -> Result<Vec<u8>, Problem> {
    let (rest, mesh, _) = load_upright(service, job, step).await?;
    let png = service.compute(move |_, _| {
        let (title, direction) = movement.direction();
        let moved = moved_along(&rest, &mesh, &direction);
        let before = Layer { mesh: &rest, values: None };
        let after = Layer { mesh: &mesh, values: None };
        let moved = Layer { mesh: &mesh, values: Some(moved.coloured()) };
        Ok(draw(&[("before", before), ("after", after), (title, moved)], &view()))
    });
    Ok(png.await?)
}
