use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use utoipa::{IntoParams, ToSchema};

use crate::http::extract::{Ids, Params};
use crate::http::result::{not_modified, tag_of, tagged};
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind};
use prosopon_formats::export::{PathStep, PathView, path_glb};
use prosopon_geometry::TriMesh;
use prosopon_jobs::{SkinFrame, SolveTask, read_frame, rest_of};
use prosopon_planning::evaluate::diverging;
use prosopon_store::{JobId, JobKind, StepRecord};

/// Time in which the whole path plays, s.
const PLAY_S: f64 = 4.0;
/// Limit of the colours of errors, mm, as in `error.png`.
const ERROR_LIMIT_MM: f64 = 3.0;

/// What the colours of a path show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::http) enum PathColour {
    /// Length of the displacement at the last step: white where nothing moves, red at the largest, in whole mm.
    #[default]
    Displacement,
    /// Signed error of the last step, from -3 mm (blue) to 3 mm (red).
    Error,
    /// No colours.
    None,
}

impl PathColour {
    fn as_str(self) -> &'static str {
        match self {
            Self::Displacement => "displacement_mm",
            Self::Error => "error_mm",
            Self::None => "none",
        }
    }
}

/// Options for the path of a solve.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct PathQuery {
    /// What the colours show; `displacement` when absent.
    #[param(inline)]
    colour: Option<PathColour>,
}

/// Read the whole path as one animated file
///
/// Returns a GLB with one morph target for each step that is solved, and an animation that plays the path in four seconds. The
/// scene's `extras` name units, steps and colours. `api/frames.md` describes it.
#[utoipa::path(get, path = "/v1/jobs/{job}/path.glb", operation_id = "getPath", tag = "results", params(("job" = Uuid, Path), PathQuery),
    responses((status = 200, description = "The path.", body = Vec<u8>, content_type = "model/gltf-binary"),
        (status = 304, description = "Not modified.")))]
pub(in crate::http) async fn path(
    State(state): State<AppState>,
    Ids(id): Ids<JobId>,
    Params(query): Params<PathQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (service, colour) = (&state.service, query.colour.unwrap_or_default());
    let job = service.job(id).await?;
    if job.kind != JobKind::Solve {
        let detail = format!("a job of kind {} has no path; name a solve", job.kind.as_str());
        return Err(Problem::new(FaultKind::NotFound, detail));
    }
    if SolveTask::of(&job).is_ok_and(|task| task.request.warm_start.is_some()) {
        let detail = "the job started from the end of another one, so its steps make no path from rest; read its steps, or \
                      solve without `warm_start`";
        return Err(Problem::new(FaultKind::NotFound, detail));
    }
    let steps = service.store().steps(id).await?;
    let Some(last) = steps.last() else {
        let detail = format!("no step is available yet; the job is {}", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()).into());
    };
    if colour == PathColour::Error && last.error.is_none() {
        let detail =
            "the last step has no error map to show; leave `colour` out, or give the session a target and solve again";
        return Err(Fault::new(FaultKind::NoReference, detail).at("/colour").into());
    }
    let mut key: Vec<&str> = steps.iter().map(|step| step.sha256.as_str()).collect();
    key.extend([colour.as_str(), "path.glb"]);
    let tag = tag_of(&key);
    if let Some(known) = not_modified(&headers, &tag) {
        return Ok(known);
    }
    let rest = rest_of(service, &job).await?;
    let mut frames = Vec::with_capacity(steps.len());
    for step in &steps {
        frames.push(read_frame(service, step, &rest).await?);
    }
    let bytes = service.compute(move |_, _| Ok(written(&rest, &steps, &frames, colour))).await?;
    tagged(&headers, &tag, "model/gltf-binary", bytes?.into())
}

/// The file of a path.
fn written(rest: &TriMesh, steps: &[StepRecord], frames: &[SkinFrame], colour: PathColour) -> Result<Vec<u8>, Fault> {
    let moved = steps.iter().zip(frames).map(|(step, frame)| {
        let name = format!("step {} (t = {})", step.k, step.t);
        Ok(PathStep { name, time_s: PLAY_S * step.t, moved: frame.mesh(rest)? })
    });
    let moved: Vec<PathStep> = moved.collect::<Result<_, Fault>>()?;
    let last = frames.last();
    let values = match colour {
        PathColour::Displacement => last.map(|frame| frame.displacement_mm.as_slice()),
        PathColour::Error => last.and_then(|frame| frame.error_mm.as_deref()),
        PathColour::None => None,
    };
    let limit_mm = match colour {
        PathColour::Displacement => values.iter().copied().flatten().fold(1.0f32, |most, v| most.max(*v)).ceil().into(),
        PathColour::Error | PathColour::None => ERROR_LIMIT_MM,
    };
    let colours: Option<Vec<[u8; 3]>> =
        values.map(|values| values.iter().map(|v| diverging(f64::from(*v), limit_mm)).collect());
    let times: Vec<f64> = steps.iter().map(|step| step.t).collect();
    let mut extras = serde_json::json!({
        "length_unit": "mm", "frame": "patient LPS; the node's matrix leads to glTF's metres",
        "path_parameters": times, "seconds": PLAY_S,
    });
    if colours.is_some() {
        let low = if colour == PathColour::Error { -limit_mm } else { 0.0 };
        extras["colour"] = serde_json::json!({ "shows": colour.as_str(), "min_mm": low, "max_mm": limit_mm });
    }
    Ok(path_glb(&PathView { rest, steps: &moved, colours: colours.as_deref(), extras: &extras.to_string() }))
}
