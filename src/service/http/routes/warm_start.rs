use std::collections::BTreeSet;

use crate::http::auth::Principal;
use crate::http::{AppState, Problem};
use prosopon_jobs::{EarlierSolve, SolveRequest};
use prosopon_session::{Fault, FaultKind, PlanDocument};
use prosopon_store::{JobId, JobKind, JobState, SessionId};

/// So many jobs may begin at each other's end: all of them are solved again where nothing of them is in memory.
const MAX_DEPTH: usize = 16;

/// `solve`, begun at the end of the job `id`.
pub(super) async fn begin_at(
    state: &AppState,
    principal: &Principal,
    session: SessionId,
    id: JobId,
    solve: SolveRequest,
) -> Result<SolveRequest, Problem> {
    let refused = |detail: String| Fault::new(FaultKind::InvalidRequest, detail).at("/warm_start");
    let unknown = |fault: Fault| Fault { kind: FaultKind::InvalidRequest, ..fault.at("/warm_start") };
    let job = state.service.job_of(&principal.tenant, id).await.map_err(unknown)?;
    if job.kind != JobKind::Solve || job.state != JobState::Succeeded {
        let detail = format!("job {id} is no solve that has succeeded: it is {} and {}", job.kind.as_str(), job.state);
        return Err(refused(detail).into());
    }
    let Ok(before) = serde_json::from_str::<SolveRequest>(&job.request) else {
        return Err(refused(format!("job {id} solved a ready tissue mesh, which jobs do not begin at")).into());
    };
    if job.session != session {
        return Err(refused(format!("job {id} is of another session")).into());
    }
    if let Some(what) = difference(&before, &solve) {
        return Err(refused(format!("job {id} had {what}")).into());
    }
    let earlier = EarlierSolve { job: id, plan: before.plan, steps: before.steps, warm_start: before.warm_start };
    let depth = earlier.depth();
    if depth > MAX_DEPTH {
        let detail = format!("{depth} jobs would begin at each other's end, at most {MAX_DEPTH} may: solve from rest");
        return Err(refused(detail).into());
    }
    Ok(SolveRequest { warm_start: Some(Box::new(earlier)), ..solve })
}

/// What keeps one solve from beginning at the end of another.
fn difference(before: &SolveRequest, now: &SolveRequest) -> Option<&'static str> {
    let segments = |plan: &PlanDocument| plan.paths.iter().map(|p| p.segment).collect::<BTreeSet<_>>();
    [
        (before.mesh_key != now.mesh_key, "another tissue mesh"),
        (before.cuts != now.cuts, "other cuts"),
        (segments(&before.plan) != segments(&now.plan), "other segments that move"),
        (before.physics != now.physics, "another model, other materials or other settings"),
        (before.attachment != now.attachment, "another attachment"),
    ]
    .into_iter()
    .find_map(|(differs, what)| differs.then_some(what))
}
