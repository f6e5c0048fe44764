use super::{Prediction, read_frame, rest_of};
use crate::Service;
use prosopon_contract::SurfaceSource;
use prosopon_contract::{Fault, FaultKind, LandmarksDocument, PathDocument, PlanDocument};
use prosopon_geometry::Point;
use prosopon_session::{SessionParts, load_mesh};
use prosopon_store::{JobRecord, PartKind, SessionId};
use serde::Deserialize;

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

/// Two predictions that are compared with each other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Predictions {
    /// Names of the models of both.
    pub models: [String; 2],
    /// Whether both follow the same paths.
    pub same_plan: bool,
}

impl Predictions {
    /// Models and plans of two jobs; `None` when one of them is not a solve.
    #[must_use]
    pub fn of(one: &JobRecord, other: &JobRecord) -> Option<Self> {
        let (one, other) = (solve_of(one)?, solve_of(other)?);
        Some(Self { same_plan: one.1 == other.1, models: [one.0, other.0] })
    }

    /// Models and plans of two surfaces; `None` when one of them is not a step of a solve.
    ///
    /// # Errors
    /// As [`named_surface`].
    pub async fn of_surfaces(service: &Service, sources: [SurfaceSource; 2]) -> Result<Option<Self>, Fault> {
        let [SurfaceSource::Step(one, _), SurfaceSource::Step(other, _)] = sources else { return Ok(None) };
        Ok(Self::of(&service.job(one).await?, &service.job(other).await?))
    }
}

/// Model and paths of a solve, on the session's own mesh or on an uploaded one.
fn solve_of(job: &JobRecord) -> Option<(String, Vec<PathDocument>)> {
    #[derive(Deserialize)]
    struct Solve {
        model: Option<String>,
        physics: Option<Physics>,
        plan: PlanDocument,
    }
    #[derive(Deserialize)]
    struct Physics {
        model: String,
    }
    let solve: Solve = serde_json::from_str(&job.request).ok()?;
    let model = solve.model.or_else(|| Some(solve.physics?.model))?;
    Some((model, solve.plan.paths))
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
            let face = Some(face_of(&SessionParts::load(&service.store, job.session).await?)?);
            let (mesh, displacement_mm) = (frame.mesh(&rest)?, Some(frame.displacement_mm));
            Ok(Prediction { mesh, displacement_mm, rest: Some(rest), face })
        }
        SurfaceSource::Skin(session) | SurfaceSource::Skull(session) | SurfaceSource::Target(session) => {
            let kind = part_of(source);
            let parts = SessionParts::load(&service.store, session).await?;
            let mesh = load_mesh(&service.store, parts.require(kind)?).await?;
            let face = if kind == PartKind::Skull { None } else { Some(face_of(&parts)?) };
            Ok(Prediction { mesh, displacement_mm: None, rest: None, face })
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

/// Landmarks (LPS mm) and x of the midline (mm) of a session, which place the parts of the face.
///
/// # Errors
/// [`FaultKind::Internal`] when the stored document cannot be read.
pub fn face_of(parts: &SessionParts) -> Result<(Vec<(String, Point)>, Option<f64>), Fault> {
    let landmarks = parts.landmarks()?;
    let points = landmarks.as_ref().map(LandmarksDocument::named_points).unwrap_or_default();
    Ok((points, landmarks.and_then(|l| l.midline_x_mm)))
}
