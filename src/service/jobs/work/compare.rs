use std::collections::BTreeMap;

use super::Context;
use crate::requests::SolveTask;
use crate::tasks::{Predictions, read_frame, rest_of};
use prosopon_contract::{Fault, Halt};
use prosopon_geometry::TriMesh;
use prosopon_session::{SessionParts, load_mesh};
use prosopon_store::{JobId, PartKind};

/// Reference of the steps of a solve.
#[derive(Debug)]
pub(super) enum Reference {
    /// The post-operative skin, at every step.
    Target(TriMesh),
    /// Steps of another job at the same path parameters.
    ///
    /// By this job's step number: the other job's step number and skin.
    Job {
        id: String,
        /// Names of the models of this job and of the other job.
        models: Option<[String; 2]>,
        steps: BTreeMap<u32, (u32, TriMesh)>,
    },
}

impl Reference {
    /// Loads the session's target surface, or else the reference job; `None` when there is neither.
    pub(super) async fn load(
        context: &Context,
        parts: &SessionParts,
        request: &SolveTask,
    ) -> Result<Option<Self>, Halt> {
        let store = &context.service.store;
        if !request.request.wants_error_maps() {
            return Ok(None);
        }
        if let Some(target) = parts.get(PartKind::Target) {
            return Ok(Some(Self::Target(load_mesh(store, target).await?)));
        }
        let Some(id) = request.request.reference_job.map(JobId::from) else { return Ok(None) };
        let job = context.service.job(id).await?;
        let rest = rest_of(&context.service, &job).await?;
        let (n, mut steps) = (f64::from(request.request.steps()), BTreeMap::new());
        for step in store.steps(id).await.map_err(Fault::from)? {
            let own = (step.t * n).round();
            if (step.t - own / n).abs() < 1e-9 {
                let frame = read_frame(&context.service, &step, &rest).await?;
                steps.insert(own as u32, (step.k, frame.mesh(&rest)?));
            }
        }
        let models = Predictions::of(&context.job, &job).map(|both| both.models);
        Ok(Some(Self::Job { id: id.to_string(), models, steps }))
    }

    /// Names of the models of this job and of the reference; `None` when the reference is not a prediction.
    pub(super) fn models(&self) -> Option<[String; 2]> {
        match self {
            Self::Target(_) => None,
            Self::Job { models, .. } => models.clone(),
        }
    }

    /// Name and surface of the reference of step `k`.
    pub(super) fn at(&self, k: u32) -> Option<(String, &TriMesh)> {
        match self {
            Self::Target(mesh) => Some(("target".to_owned(), mesh)),
            Self::Job { id, steps, .. } => steps.get(&k).map(|(other, mesh)| (format!("job {id} step {other}"), mesh)),
        }
    }
}
