use std::collections::BTreeSet;

use crate::http::auth::Principal;
use crate::http::{AppState, Problem};
use prosopon_contract::{Fault, FaultKind, PlanDocument};
use prosopon_jobs::{EarlierSolve, SolveTask};
use prosopon_store::{JobId, JobKind, JobState, SessionId};

/// Longest chain of warm starts; if no state of the chain is in memory, all its jobs are solved again.
const MAX_DEPTH: usize = 16;

/// Makes `solve` start from the end state of the job `id`.
pub(super) async fn with_warm_start(
    state: &AppState,
    principal: &Principal,
    session: SessionId,
    id: JobId,
    solve: SolveTask,
) -> Result<SolveTask, Problem> {
    let refused = |detail: String| Fault::new(FaultKind::InvalidRequest, detail).at("/warm_start");
    let unknown = |fault: Fault| Fault { kind: FaultKind::InvalidRequest, ..fault.at("/warm_start") };
    let job = state.service.job_of(&principal.tenant, id).await.map_err(unknown)?;
    if job.kind != JobKind::Solve || job.state != JobState::Succeeded {
        let detail = format!("job {id} is not a succeeded solve but a {} that is {}", job.kind.as_str(), job.state);
        return Err(refused(detail).into());
    }
    let before = SolveTask::of(&job).map_err(|why| refused(format!("job {id} {why}; solve from rest")))?;
    if job.session != session {
        return Err(refused(format!("job {id} belongs to another session; name a job of this session")).into());
    }
    if let Some(what) = difference(&before, &solve) {
        return Err(refused(format!("job {id} had {what}; solve from rest")).into());
    }
    let earlier =
        EarlierSolve { job: id, plan: before.plan, steps: before.request.steps(), warm_start: before.warm_start };
    let depth = earlier.depth();
    if depth > MAX_DEPTH {
        let detail = format!("the warm-start chain has {depth} jobs, at most {MAX_DEPTH} are allowed; solve from rest");
        return Err(refused(detail).into());
    }
    Ok(SolveTask { warm_start: Some(Box::new(earlier)), ..solve })
}

/// The first difference that rules out a warm start from the solve `before`.
fn difference(before: &SolveTask, now: &SolveTask) -> Option<&'static str> {
    let segments = |plan: &PlanDocument| plan.paths.iter().map(|p| p.segment).collect::<BTreeSet<_>>();
    [
        (before.mesh_key != now.mesh_key, "another tissue mesh"),
        (before.cuts != now.cuts, "other cuts"),
        (segments(&before.plan) != segments(&now.plan), "other moving segments"),
        (
            before.request.options() != now.request.options()
                || before.request.leave_out_below_mm() != now.request.leave_out_below_mm(),
            "another model, other materials or other settings",
        ),
        (before.request.attachment != now.request.attachment, "another attachment"),
    ]
    .into_iter()
    .find_map(|(differs, what)| differs.then_some(what))
}
