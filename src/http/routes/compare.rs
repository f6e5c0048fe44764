use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use crate::export::SurfaceView;
use crate::http::dto::{CheckedCompare, CompareRequest, CompareView, Named, finite};
use crate::http::extract::{Body, Params};
use crate::http::surface_format::SurfaceOutput;
use crate::http::{AppState, Problem};
use crate::jobs::{self, Compared, Comparison, Prediction, read_frame, rest_of};
use crate::session::{FaultKind, SessionParts, error_sheet, load_mesh};
use crate::store::PartKind;

/// Form of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum CompareForm {
    /// Statistics.
    Json,
    /// A sheet with the map from all sides.
    Png,
    /// Binary glTF 2.0 of the prediction with `error_mm`.
    Glb,
    /// Binary PLY of it.
    Ply,
    /// VTK polygons of it.
    Vtp,
}

/// Which form to send.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct CompareQuery {
    /// Form; else JSON.
    #[param(inline)]
    format: Option<CompareForm>,
}

/// Compare two stored surfaces
///
/// Signed error of one against the other, on demand after rigid registration: statistics, a picture, or the surface with the error of
/// every vertex. A surface stays in the prediction's frame.
#[utoipa::path(post, path = "/v1/compare", tag = "results", request_body = CompareRequest, params(CompareQuery),
    responses((status = 200, description = "the error map", content(
        (CompareView = "application/json"), (Vec<u8> = "image/png"), (Vec<u8> = "model/gltf-binary"),
        (Vec<u8> = "application/ply"), (Vec<u8> = "application/vnd.vtk.vtp")))))]
pub(in crate::http) async fn compare(
    State(state): State<AppState>,
    Params(query): Params<CompareQuery>,
    Body(request): Body<CompareRequest>,
) -> Result<Response, Problem> {
    let CheckedCompare { prediction, reference, mask, exclude, register, values } = request.check()?;
    let (prediction, _) = surface(&state, prediction).await?;
    let (reference, reference_name) = surface(&state, reference).await?;
    let comparison =
        Comparison { prediction, reference: reference.mesh, reference_name, mask, exclude, face_only: false, register };
    let compared = jobs::compare(&state.service, comparison).await?;
    let format = match query.format.unwrap_or(CompareForm::Json) {
        CompareForm::Json => return Ok(axum::Json(view(compared, values)).into_response()),
        CompareForm::Png => {
            let png = state
                .service
                .compute(move |_, _| Ok(error_sheet(&compared.mesh, &compared.error_mm, &compared.document)));
            return Ok(([(header::CONTENT_TYPE, "image/png")], png.await?).into_response());
        }
        CompareForm::Glb => SurfaceOutput::Glb,
        CompareForm::Ply => SurfaceOutput::Ply,
        CompareForm::Vtp => SurfaceOutput::Vtp,
    };
    let bytes = state.service.compute(move |_, _| Ok(write(&compared, format))).await?;
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, axum::http::HeaderValue::from_static(format.media_type()));
    Ok((headers, bytes).into_response())
}

fn view(compared: Compared, values: bool) -> CompareView {
    let Compared { document, error_mm, correspondence_mm, .. } = compared;
    CompareView {
        content: document,
        values_mm: values.then(|| finite(error_mm)),
        correspondence_mm: correspondence_mm.filter(|_| values).map(finite),
    }
}

fn write(compared: &Compared, format: SurfaceOutput) -> Vec<u8> {
    let mut scalars = vec![("error_mm", compared.error_mm.as_slice())];
    scalars.extend(compared.correspondence_mm.as_deref().map(|c| ("correspondence_mm", c)));
    format.write(&SurfaceView { mesh: &compared.mesh, scalars: &scalars, colours: None })
}

/// The surface that is named, and its name in words.
async fn surface(state: &AppState, named: Named) -> Result<(Prediction, String), Problem> {
    let store = state.service.store();
    match named {
        Named::Part(session, kind) => {
            let parts = SessionParts::load(store, session.into()).await?;
            let mesh = load_mesh(store, parts.require(kind)?).await?;
            let face = if kind == PartKind::Skull { None } else { Some(face_of(&parts)?) };
            let name = format!("{} of session {session}", kind.as_str());
            Ok((Prediction { mesh, displacement_mm: None, rest: None, face }, name))
        }
        Named::Step(id, k) => {
            let job = state.service.job(id.into()).await?;
            let step = store.step(job.id, k).await?;
            let step = step.ok_or_else(|| Problem::new(FaultKind::NotFound, format!("job {id} has no step {k}")))?;
            let rest = rest_of(&state.service, &job).await?;
            let frame = read_frame(&state.service, &step, &rest).await?;
            let face = Some(face_of(&SessionParts::load(store, job.session).await?)?);
            let (mesh, displacement_mm) = (frame.mesh(&rest)?, Some(frame.displacement_mm));
            let prediction = Prediction { mesh, displacement_mm, rest: Some(rest), face };
            Ok((prediction, format!("job {id} step {k}")))
        }
    }
}

/// What places the parts of the face: landmarks and midline of the session.
pub(super) fn face_of(parts: &SessionParts) -> Result<(Vec<(String, crate::geometry::Point)>, Option<f64>), Problem> {
    let landmarks = parts.landmarks()?;
    let points = landmarks.as_ref().map(crate::session::LandmarksDocument::named_points).unwrap_or_default();
    Ok((points, landmarks.and_then(|l| l.midline_x_mm)))
}
