use crate::http::Problem;
use prosopon_contract::ReportDocument;
use prosopon_geometry::{Motion, TriMesh};
use prosopon_jobs::{Service, SkinFrame, read_frame, rest_of};
use prosopon_store::{JobRecord, StepRecord};

/// Skin at rest, skin at a step, and the frame of the step.
pub(super) async fn load(
    service: &Service,
    job: &JobRecord,
    step: &StepRecord,
) -> Result<(TriMesh, TriMesh, SkinFrame), Problem> {
    let rest = rest_of(service, job).await?;
    let frame = read_frame(service, step, &rest).await?;
    let mesh = frame.mesh(&rest)?;
    Ok((rest, mesh, frame))
}

/// As [`load`], in the frame of the head as the job's report states it, for pictures; in LPS before the job has ended.
pub(super) async fn load_upright(
    service: &Service,
    job: &JobRecord,
    step: &StepRecord,
) -> Result<(TriMesh, TriMesh, SkinFrame), Problem> {
    let (rest, mesh, frame) = load(service, job, step).await?;
    let into = upright(job);
    Ok((rest.moved(&into), mesh.moved(&into), frame))
}

/// The motion into the frame of the head.
pub(super) fn upright(job: &JobRecord) -> Motion {
    let report = job.report.as_deref().and_then(|text| serde_json::from_str::<ReportDocument>(text).ok());
    report.and_then(|report| report.frame).map_or_else(Motion::identity, |frame| frame.motion())
}
