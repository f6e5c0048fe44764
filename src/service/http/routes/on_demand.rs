use serde::Deserialize;
use utoipa::IntoParams;

use super::step_surface::load;
use crate::http::Problem;
use prosopon_contract::{Fault, FaultKind, RegisterOn};
use prosopon_geometry::TriMesh;
use prosopon_jobs::{Compared, Comparison, Prediction, Predictions, Service, face_of, read_frame, rest_of};
use prosopon_planning::evaluate::Mask;
use prosopon_session::{SessionParts, load_mesh};
use prosopon_store::{JobId, JobRecord, PartKind, StepRecord};

/// Options for an error map that is computed on demand.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct ErrorQuery {
    /// Id of a job whose step at the same path parameter replaces the reference of the stored error map.
    #[param(value_type = Option<Uuid>)]
    pub(super) reference: Option<JobId>,
    /// Whether to register the prediction on the skin that the plan does not move; false when absent.
    pub(super) register: Option<bool>,
}

impl ErrorQuery {
    /// Whether the request needs more than the stored map.
    pub(super) fn is_asked(&self) -> bool {
        self.reference.is_some() || self.register == Some(true)
    }

    /// Key of the step and of everything that its error map on demand depends on.
    pub(super) async fn key(&self, service: &Service, job: &JobRecord, step: &StepRecord) -> Result<String, Problem> {
        if !self.is_asked() {
            return Ok(step.sha256.clone());
        }
        let register = self.register == Some(true);
        let against = match self.reference {
            Some(id) => reference_step(service, job, id, step).await?.1.sha256,
            None => target(service, job).await?.1,
        };
        let parts = SessionParts::load(service.store(), job.session).await?;
        let [landmarks, frame] =
            [PartKind::Landmarks, PartKind::Frame].map(|kind| parts.get(kind).map_or("", |p| p.key.as_str()));
        Ok(format!("{} {against} {register} {landmarks} {frame}", step.sha256))
    }
}

/// Computes the error of a step against another reference, or after registration.
pub(super) async fn compared(
    service: &Service,
    job: &JobRecord,
    step: &StepRecord,
    query: &ErrorQuery,
) -> Result<Compared, Problem> {
    let (rest, mesh, frame) = load(service, job, step).await?;
    let face = Some(face_of(service, &SessionParts::load(service.store(), job.session).await?).await?);
    let (reference, reference_name, predictions) = match query.reference {
        Some(id) => {
            let (other, found) = reference_step(service, job, id, step).await?;
            let rest = rest_of(service, &other).await?;
            let predictions = Predictions::of(job, &other);
            (read_frame(service, &found, &rest).await?.mesh(&rest)?, format!("job {id} step {}", found.k), predictions)
        }
        None => (target(service, job).await?.0, "target".to_owned(), None),
    };
    let comparison = Comparison {
        prediction: Prediction {
            mesh,
            displacement_mm: Some(frame.displacement_mm),
            rest: Some(rest),
            face,
            // Cutting the bone again may take longer than a request should.
            bone: Err("an error map on demand does not use the bone; POST /v1/compare does".to_owned()),
        },
        reference,
        reference_name,
        predictions,
        mask: Mask::default(),
        exclude: Vec::new(),
        exclude_eyes: false,
        face_only: true,
        register: (query.register == Some(true)).then(RegisterOn::default),
    };
    Ok(prosopon_jobs::compare(service, comparison).await?)
}

/// The step of another job of the same tenant at the same path parameter.
async fn reference_step(
    service: &Service,
    own: &JobRecord,
    id: JobId,
    step: &StepRecord,
) -> Result<(JobRecord, StepRecord), Problem> {
    let job = service.job_of(&own.tenant, id).await?;
    let steps = service.store().steps(id).await?;
    match steps.into_iter().find(|s| (s.t - step.t).abs() < 1e-9) {
        Some(found) => Ok((job, found)),
        None => {
            let detail = format!("job {id} has no step at path parameter {:.3}", step.t);
            Err(Fault::new(FaultKind::NoReference, detail).into())
        }
    }
}

/// The post-operative skin and its key.
async fn target(service: &Service, job: &JobRecord) -> Result<(TriMesh, String), Problem> {
    let parts = SessionParts::load(service.store(), job.session).await?;
    let Some(part) = parts.get(PartKind::Target) else {
        let detail = "there is no reference: the session has no target and the request names no reference job";
        return Err(Fault::new(FaultKind::NoReference, detail).into());
    };
    Ok((load_mesh(service.store(), part).await?, part.key.clone()))
}
