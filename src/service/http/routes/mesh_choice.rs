use uuid::Uuid;

use crate::http::{AppState, Problem};
use prosopon_contract::{CutDocument, Fault, FaultKind, MeshRequest};
use prosopon_jobs::{MeshChoice, MeshTask};
use prosopon_session::SessionParts;
use prosopon_store::{JobFilter, JobId, JobKind, JobState, OsteotomyId, SessionId};

/// Number of meshes of a session that are searched, newest first.
const MOST: u32 = 100;

/// The mesh for a solve with `cuts`.
///
/// It is the mesh that the job `asked` built, else the newest mesh that matches, else a new mesh with the settings of the
/// newest one. A mesh matches if it was built for the same cuts or for none.
pub(super) async fn mesh_of(
    state: &AppState,
    parts: &SessionParts,
    session: SessionId,
    osteotomy: OsteotomyId,
    cuts: &[CutDocument],
    asked: Option<Uuid>,
) -> Result<MeshChoice, Problem> {
    let built = JobFilter {
        session: Some(session),
        kind: Some(JobKind::Mesh),
        state: Some(JobState::Succeeded),
        limit: MOST,
        ..JobFilter::default()
    };
    let jobs = state.service.store().jobs(&built).await?;
    let mut meshes = jobs.iter().filter_map(|job| Some((job, serde_json::from_str::<MeshTask>(&job.request).ok()?)));
    if let Some(id) = asked.map(JobId::from) {
        let Some((_, mesh)) = meshes.find(|(job, _)| job.id == id) else {
            let detail = format!("job {id} is not a succeeded mesh job of this session; name one, or leave it out");
            return Err(Fault::new(FaultKind::InvalidRequest, detail).at("/mesh").into());
        };
        return asked_for(parts, osteotomy, cuts, id, mesh);
    }
    // The session keeps its mesh longer than the job that built it.
    let last = parts.mesh()?.map(|mesh| MeshChoice { settings: mesh.settings, cuts: mesh.cuts });
    let meshes = meshes.map(|(_, mesh)| MeshChoice { settings: mesh.settings, cuts: mesh.cuts });
    let meshes: Vec<MeshChoice> = meshes.chain(last).collect();
    let fitting = meshes.iter().find(|mesh| fits(mesh.cuts.as_deref(), cuts));
    Ok(match (fitting, meshes.first()) {
        (Some(mesh), _) => mesh.clone(),
        (None, Some(newest)) => MeshChoice { settings: newest.settings.clone(), cuts: Some(cuts.to_vec()) },
        (None, None) => MeshChoice { settings: MeshRequest::default(), cuts: Some(cuts.to_vec()) },
    })
}

fn fits(mesh: Option<&[CutDocument]>, cuts: &[CutDocument]) -> bool {
    mesh.is_none_or(|built_for| built_for == cuts)
}

fn asked_for(
    parts: &SessionParts,
    osteotomy: OsteotomyId,
    cuts: &[CutDocument],
    id: JobId,
    mesh: MeshTask,
) -> Result<MeshChoice, Problem> {
    let wrong = |kind, detail: String| Problem(Fault::new(kind, detail).at("/mesh"));
    if !fits(mesh.cuts.as_deref(), cuts) {
        let other = mesh.osteotomy_id.map_or_else(|| "other cuts".to_owned(), |o| format!("osteotomy {o}"));
        let detail = format!("job {id} built its mesh for {other}, but the plan is for osteotomy {osteotomy}");
        return Err(wrong(FaultKind::WrongState, detail));
    }
    if mesh.key != parts.mesh_key(&mesh.settings, mesh.cuts.as_deref())? {
        let detail = format!("inputs or settings have changed since job {id} built its mesh; build it again");
        return Err(wrong(FaultKind::Stale, detail));
    }
    Ok(MeshChoice { settings: mesh.settings, cuts: mesh.cuts })
}
