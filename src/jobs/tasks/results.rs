use crate::geometry::TriMesh;
use crate::jobs::{Service, SkinFrame};
use crate::session::{Fault, FaultKind};
use crate::store::{JobKind, JobRecord, StepRecord, decode_mesh};

/// The skin at rest that a job deforms.
///
/// # Errors
/// [`FaultKind::NotFound`] for a job without skin, [`FaultKind::NotReady`] before it has begun, or the store's.
pub async fn rest_of(service: &Service, job: &JobRecord) -> Result<TriMesh, Fault> {
    if job.kind != JobKind::Solve {
        return Err(Fault::new(FaultKind::NotFound, format!("a job of kind {} has no skin", job.kind.as_str())));
    }
    let Some(blob) = &job.rest_blob else {
        let detail = format!("the job is {} and has not read its inputs yet", job.state);
        return Err(Fault::new(FaultKind::NotReady, detail).with("job_status", job.state.as_str()));
    };
    Ok(decode_mesh(&service.store.blobs().get(blob).await?)?)
}

/// The frame of a step.
///
/// # Errors
/// The store's.
pub async fn read_frame(service: &Service, step: &StepRecord, rest: &TriMesh) -> Result<SkinFrame, Fault> {
    SkinFrame::decode(&service.store.blobs().get(&step.blob).await?, rest.positions().len())
}
