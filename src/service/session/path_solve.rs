//! Solves along plans, from rest or from the end state of an earlier solve.

use std::sync::Arc;

use super::case::Earlier;
use super::keys::bone_key;
use super::recent::Recent;
use super::{Run, key_of};
use prosopon_contract::Halt;
use prosopon_geometry::control::Control;
use prosopon_planning::plan::{self, Plan};
use prosopon_planning::simulate::{
    self, CutBone, OnFrame, Outcome, PathCheckpoint, PathStart, PreparedTissue, RunSettings, SimulateError, TissueModel,
};
use prosopon_tissue::fem::{SolveError, StartState};

/// Share of a solve's progress for preparing the equations.
const PREPARING: f64 = 0.05;
/// Kinds of intermediate results in the cache.
const EQUATIONS: &str = "equations";
const ENDS: &str = "end";
/// Memory of prepared equations for each node, bytes: on a head about 400 MB for 20 000 nodes.
const EQUATION_BYTES: u64 = 20_000;

/// Inputs that all paths of a run share.
pub(super) struct Ready<'a> {
    pub(super) run: &'a Run,
    pub(super) bone: &'a CutBone,
    pub(super) tissue: &'a TissueModel,
}

/// A plan to follow, with its start state.
#[derive(Clone, Copy)]
pub(super) struct PathSolve<'a> {
    pub(super) plan: &'a Plan,
    pub(super) steps: usize,
    pub(super) after: Option<&'a Earlier>,
    /// Checkpoint of an earlier attempt, from which to continue.
    pub(super) checkpoint: Option<&'a PathCheckpoint>,
}

impl<'a> From<&'a Earlier> for PathSolve<'a> {
    fn from(earlier: &'a Earlier) -> Self {
        Self { plan: &earlier.plan, steps: earlier.steps, after: earlier.after.as_deref(), checkpoint: None }
    }
}

/// Key of everything that the prepared equations depend on.
///
/// They do not depend on the motions along the path or on the number of steps.
fn prepared_key(Ready { run, bone, .. }: &Ready<'_>, plan: &Plan) -> String {
    let moving: Vec<u32> = plan.paths.iter().map(plan::Path::segment).collect();
    let RunSettings { solver, attachment, leave_out_below_mm, steps: _ } = &run.settings;
    let displacement_mm = simulate::displacement_class_mm(bone, plan);
    let settings = format!("{moving:?} {displacement_mm:?} {leave_out_below_mm:?} {solver:?} {attachment:?}");
    key_of(&[&run.tissue.key, &bone_key(&run.case, &run.cuts), &settings])
}

/// Key of the end state of a path.
fn end_key(ready: &Ready<'_>, path: PathSolve<'_>) -> String {
    let after = path.after.map(|earlier| end_key(ready, earlier.into())).unwrap_or_default();
    key_of(&[&prepared_key(ready, path.plan), &format!("{:?} {}", path.plan, path.steps), &after])
}

/// Follows a path from its start state.
///
/// An earlier solve is repeated when its end state is not in the cache.
pub(super) fn solve_path(
    recent: &Recent,
    ready: &Ready<'_>,
    path: PathSolve<'_>,
    control: &Control,
    on_frame: &mut OnFrame<'_>,
) -> Result<Outcome, Halt> {
    let Ready { run, bone, tissue } = ready;
    let mut control = control.stage(0.0, 1.0);
    let mut from = None;
    if let (Some(earlier), None) = (path.after, path.checkpoint) {
        from = recent.get::<StartState>(ENDS, &end_key(ready, earlier.into()));
        if from.is_none() {
            let found = solve_path(recent, ready, earlier.into(), &control.stage(0.0, 0.5), &mut |_, _| ())?;
            control = control.stage(0.5, 1.0);
            from = Some(Arc::new(found.end));
        }
    }
    let settings = RunSettings { steps: path.steps, ..run.settings.clone() };
    let key = prepared_key(ready, path.plan);
    let prepared = if let Some(found) = recent.get::<PreparedTissue>(EQUATIONS, &key) {
        found
    } else {
        recent.let_go(EQUATIONS);
        let before = control.stage(0.0, PREPARING);
        let made = Arc::new(PreparedTissue::new(tissue, bone, path.plan, &settings, &before)?);
        recent.put(EQUATIONS, &key, Arc::clone(&made), tissue.report.nodes as u64 * EQUATION_BYTES);
        made
    };
    let control = control.stage(PREPARING, 1.0);
    let start = PathStart { plan: path.plan, warm_start: from.as_deref(), resume: path.checkpoint };
    let anatomy = &run.case.anatomy;
    let outcome = simulate::solve_prepared(anatomy, tissue, &prepared, bone, start, &settings, &control, on_frame);
    if let Err(SimulateError::Solve(SolveError::Checkpoint { detail })) = outcome {
        tracing::warn!(detail, "the checkpoint does not match this job; all steps are solved again");
        return solve_path(recent, ready, PathSolve { checkpoint: None, ..path }, &control, on_frame);
    }
    let outcome = outcome?;
    let end = Arc::new(outcome.end.clone());
    recent.put(ENDS, &end_key(ready, path), Arc::clone(&end), end.bytes());
    Ok(outcome)
}
