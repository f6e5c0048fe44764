//! The further job that goes on where a budget was missed.

use super::{Context, Continuation};
use crate::budget::demand_of;
use crate::events::status_event;
use crate::requests::{MeshChoice, SolveTask};
use prosopon_contract::{BudgetDocument, Fault, LockingName, MeshRequest, SolveRequest, TriedDocument, to_json};
use prosopon_geometry::Warning;
use prosopon_planning::simulate::budget::{KnownMesh, Limits, Tried, choose_after};
use prosopon_session::SessionParts;
use prosopon_store::{JobKind, JobRecord, JobState};

/// What one solve with a budget took.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spent {
    /// Nodes of its mesh.
    pub(super) nodes: usize,
    /// Time of the mesh, s.
    pub(super) mesh_s: f64,
    /// Time of the path, s.
    pub(super) path_s: f64,
}

/// The further job after a solve that missed the error of its budget, or had none, if a better setting is expected to end in time.
///
/// Names it in `budget`, and returns it with a note that says what follows; nothing where the budget asks for no more.
pub(super) fn go_on(
    context: &Context,
    parts: &SessionParts,
    task: &SolveTask,
    budget: &mut BudgetDocument,
    spent: Spent,
) -> Result<Option<(Option<Continuation>, Warning)>, Fault> {
    let (Some(estimated), Some(spent_s)) = (budget.estimated, budget.spent_s) else { return Ok(None) };
    let asked_mm = budget.asked.max_error_mm;
    if !budget.asked.go_on || asked_mm.is_some_and(|asked| estimated.error_mm <= asked) {
        return Ok(None);
    }
    let tried = TriedDocument {
        job: context.job.id.uuid(),
        chosen: budget.chosen,
        expected: budget.expected,
        estimated,
        spent_s,
    };
    let all_tried: Vec<TriedDocument> = budget.tried.iter().copied().chain([tried]).collect();
    let job_s = context.job.max_wall_s.map(|_| context.running.control.left_s());
    let tried_s = budget.tried_s() + tried.spent_s + tried.estimated.wall_s;
    let budget_s = budget.asked.max_wall_s.map(|most| most - tried_s);
    let limits = Limits { error_mm: asked_mm, wall_s: job_s.into_iter().chain(budget_s).reduce(f64::min) };
    let edge_mm = task.mesh.settings.edge_mm;
    let known = KnownMesh { edge_mm, nodes: spent.nodes, wall_s: spent.mesh_s, is_kept: true };
    let demand = demand_of(&task.request, &task.mesh, &task.plan, task.given, Some(known));
    let solved =
        Tried { edge_mm, locking: budget.chosen.locking.into(), error_mm: estimated.error_mm, path_s: spent.path_s };
    let Some(choice) = choose_after(&solved, &demand, limits) else { return Ok(Some((None, ends(limits.wall_s)))) };

    let mesh = MeshChoice {
        settings: MeshRequest { edge_mm: choice.chosen.edge_mm, ..task.mesh.settings.clone() },
        cuts: task.mesh.cuts.clone(),
    };
    let locking: LockingName = choice.chosen.locking.into();
    let request = SolveRequest { locking: Some(locking), max_wall_s: job_s, ..task.request.clone() };
    let document = BudgetDocument::new(budget.asked, limits.wall_s, &choice, request.solved_model(), request.steps());
    let next = SolveTask {
        mesh_key: parts.mesh_key(&mesh.settings, mesh.cuts.as_deref())?,
        mesh,
        budget: Some(BudgetDocument { tried: all_tried, ..document }),
        request,
        // The state of another mesh is no start for this one.
        warm_start: None,
        ..task.clone()
    };
    let job = JobRecord {
        steps: context.job.steps,
        subject: context.job.subject.clone(),
        max_wall_s: job_s,
        traceparent: context.job.traceparent.clone(),
        continues: Some(context.job.id),
        ..JobRecord::accepted(JobKind::Solve, context.job.session, to_json("the request of a job", &next)?)
    };
    budget.continued_by = Some(job.id.uuid());
    let message =
        format!("job {} goes on with {} mm edges and `locking` {}", job.id, choice.chosen.edge_mm, locking.as_str());
    let note = Warning::info("budget-continued", message);
    Ok(Some((Some(Box::new((job, status_event(JobState::Accepted, 0)))), note)))
}

/// The note that nothing follows.
fn ends(left_s: Option<f64>) -> Warning {
    let in_time = left_s.map_or_else(String::new, |s| format!(", within the {:.0} s that are left,", s.max(0.0)));
    Warning::info(
        "budget-ended",
        format!("no further job follows: no clearly better setting is expected to end{in_time} in 95 % of scenes"),
    )
}
