use crate::http::Problem;
use prosopon_geometry::TriMesh;
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
