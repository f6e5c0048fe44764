use super::baselines::bone_below;
use super::compare::Prediction;
use super::face::face_of;
use super::results::{read_frame, rest_of};
use crate::Service;
use prosopon_contract::{Fault, FaultKind, SurfaceSource};
use prosopon_session::{SessionParts, load_mesh};
use prosopon_store::{PartKind, SessionId};

/// Name, key and session of a stored surface.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedSurface {
    /// Name that answers show.
    pub name: String,
    /// Hash of the surface.
    pub key: String,
    /// Session of the surface.
    pub session: SessionId,
}

/// Name, key and session of a source, without loading its surface.
///
/// # Errors
/// [`FaultKind::NotFound`], [`FaultKind::Gone`], or the store's.
pub async fn named_surface(service: &Service, source: SurfaceSource) -> Result<NamedSurface, Fault> {
    match source {
        SurfaceSource::Step(id, k) => {
            let job = service.job(id).await?;
            let step = service.store.step(id, k).await?;
            let step = step.ok_or_else(|| Fault::new(FaultKind::NotFound, format!("job {id} has no step {k}")))?;
            Ok(NamedSurface { name: format!("job {id} step {k}"), key: step.sha256, session: job.session })
        }
        SurfaceSource::Skin(session) | SurfaceSource::Skull(session) | SurfaceSource::Target(session) => {
            let kind = part_of(source);
            let parts = SessionParts::load(&service.store, session).await?;
            let key = parts.require(kind)?.key.clone();
            Ok(NamedSurface { name: format!("{} of session {session}", kind.as_str()), key, session })
        }
    }
}

/// Loads the surface of a source.
///
/// # Errors
/// As [`named_surface`].
pub(crate) async fn load_surface(service: &Service, source: SurfaceSource) -> Result<Prediction, Fault> {
    match source {
        SurfaceSource::Step(id, k) => {
            let job = service.job(id).await?;
            let step = service.store.step(id, k).await?;
            let step = step.ok_or_else(|| Fault::new(FaultKind::NotFound, format!("job {id} has no step {k}")))?;
            let rest = rest_of(service, &job).await?;
            let frame = read_frame(service, &step, &rest).await?;
            let parts = SessionParts::load(&service.store, job.session).await?;
            let face = Some(face_of(service, &parts).await?);
            let bone = bone_below(service, &job, &parts, step.t).await?;
            let (mesh, displacement_mm) = (frame.mesh(&rest)?, Some(frame.displacement_mm));
            Ok(Prediction { mesh, displacement_mm, rest: Some(rest), face, bone })
        }
        SurfaceSource::Skin(session) | SurfaceSource::Skull(session) | SurfaceSource::Target(session) => {
            let kind = part_of(source);
            let parts = SessionParts::load(&service.store, session).await?;
            let mesh = load_mesh(&service.store, parts.require(kind)?).await?;
            let face = if kind == PartKind::Skull { None } else { Some(face_of(service, &parts).await?) };
            let bone = Err("the prediction is not a step of a solve".to_owned());
            Ok(Prediction { mesh, displacement_mm: None, rest: None, face, bone })
        }
    }
}

fn part_of(source: SurfaceSource) -> PartKind {
    match source {
        SurfaceSource::Skull(_) => PartKind::Skull,
        SurfaceSource::Target(_) => PartKind::Target,
        // Never called for a step, which has its own blob.
        SurfaceSource::Skin(_) | SurfaceSource::Step(..) => PartKind::Skin,
    }
}
