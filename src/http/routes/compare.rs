use axum::Json;
use axum::extract::State;

use crate::geometry::{Aabb, TriMesh};
use crate::http::dto::{CompareRequest, CompareView, Named, finite};
use crate::http::extract::Body;
use crate::http::{AppState, Problem};
use crate::jobs::{self, Comparison, RegisterOn, read_frame, rest_of};
use crate::session::{FaultKind, SessionParts, load_mesh};

/// Compare two stored surfaces
///
/// Signed error of one against the other, on demand after rigid registration.
#[utoipa::path(post, path = "/v1/compare", tag = "results", request_body = CompareRequest,
    responses((status = 200, description = "the error map", body = CompareView)))]
pub(in crate::http) async fn compare(
    State(state): State<AppState>,
    Body(request): Body<CompareRequest>,
) -> Result<Json<CompareView>, Problem> {
    let (prediction, reference) = request.check()?;
    let (prediction, _) = surface(&state, prediction).await?;
    let (reference, reference_name) = surface(&state, reference).await?;
    let boxes = |documents: &[_]| documents.iter().map(Aabb::from).collect();
    let comparison = Comparison {
        prediction,
        reference,
        reference_name,
        mask: boxes(&request.mask),
        register: request.register.as_ref().map(|r| RegisterOn { altered: boxes(&r.altered) }),
    };
    let (content, values) = jobs::compare(&state.service, comparison).await?;
    Ok(Json(CompareView { content, values_mm: request.values.then(|| finite(values)) }))
}

/// The surface that is named, and its name in words.
async fn surface(state: &AppState, named: Named) -> Result<(TriMesh, String), Problem> {
    let store = state.service.store();
    match named {
        Named::Part(session, kind) => {
            let parts = SessionParts::load(store, session.into()).await?;
            let mesh = load_mesh(store, parts.require(kind)?).await?;
            Ok((mesh, format!("{} of session {session}", kind.as_str())))
        }
        Named::Step(id, k) => {
            let job = state.service.job(id.into()).await?;
            let step = store.step(job.id, k).await?;
            let step = step.ok_or_else(|| Problem::new(FaultKind::NotFound, format!("job {id} has no step {k}")))?;
            let rest = rest_of(&state.service, &job).await?;
            let mesh = read_frame(&state.service, &step, &rest).await?.mesh(&rest)?;
            Ok((mesh, format!("job {id} step {k}")))
        }
    }
}
