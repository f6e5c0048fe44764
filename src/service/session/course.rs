//! Solves along plans, from rest or from the end state of an earlier solve.

use std::sync::Arc;

use super::case::Earlier;
use super::numerics::{Numerics, bone_key};
use super::{Halt, Run, key_of};
use prosopon_geometry::control::Control;
use prosopon_planning::plan::{self, Plan};
use prosopon_planning::simulate::{
    self, CutBone, PathCheckpoint, OnFrame, Outcome, PreparedTissue, RunSettings, SimulateError, TissueModel, SolveRequest,
};
use prosopon_tissue::fem::{SavedState, SolveError};

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
pub(super) struct Course<'a> {
    pub(super) plan: &'a Plan,
    pub(super) steps: usize,
    pub(super) after: Option<&'a Earlier>,
    /// Checkpoint of an earlier attempt, from which to continue.
    pub(super) milestone: Option<&'a PathCheckpoint>,
}

impl<'a> From<&'a Earlier> for Course<'a> {
    fn from(earlier: &'a Earlier) -> Self {
        Self { plan: &earlier.plan, steps: earlier.steps, after: earlier.after.as_deref(), milestone: None }
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
fn end_key(ready: &Ready<'_>, course: Course<'_>) -> String {
    let after = course.after.map(|earlier| end_key(ready, earlier.into())).unwrap_or_default();
    key_of(&[&prepared_key(ready, course.plan), &format!("{:?} {}", course.plan, course.steps), &after])
}

impl Numerics {
    /// Follows a path from its start state.
    ///
    /// An earlier solve is repeated when its end state is not in the cache.
    pub(super) fn follow_course(
        &self,
        ready: &Ready<'_>,
        course: Course<'_>,
        control: &Control,
        on_frame: &mut OnFrame<'_>,
    ) -> Result<Outcome, Halt> {
        let Ready { run, bone, tissue } = ready;
        let mut control = control.stage(0.0, 1.0);
        let mut from = None;
        if let (Some(earlier), None) = (course.after, course.milestone) {
            from = self.recent.get::<SavedState>(ENDS, &end_key(ready, earlier.into()));
            if from.is_none() {
                let found = self.follow_course(ready, earlier.into(), &control.stage(0.0, 0.5), &mut |_, _| ())?;
                control = control.stage(0.5, 1.0);
                from = Some(Arc::new(found.end));
            }
        }
        let settings = RunSettings { steps: course.steps, ..run.settings.clone() };
        let key = prepared_key(ready, course.plan);
        let prepared = if let Some(found) = self.recent.get::<PreparedTissue>(EQUATIONS, &key) {
            found
        } else {
            self.recent.let_go(EQUATIONS);
            let before = control.stage(0.0, PREPARING);
            let made = Arc::new(PreparedTissue::new(tissue, bone, course.plan, &settings, &before)?);
            self.recent.put(EQUATIONS, &key, Arc::clone(&made), tissue.report.nodes as u64 * EQUATION_BYTES);
            made
        };
        let control = control.stage(PREPARING, 1.0);
        let way = SolveRequest { plan: course.plan, warm_start: from.as_deref(), resume: course.milestone };
        let anatomy = &run.case.anatomy;
        let outcome = simulate::solve_prepared(anatomy, tissue, &prepared, bone, way, &settings, &control, on_frame);
        if let Err(SimulateError::Solve(SolveError::Checkpoint { detail })) = outcome {
            tracing::warn!(detail, "the checkpoint does not match this job; all steps are solved again");
            return self.follow_course(ready, Course { milestone: None, ..course }, &control, on_frame);
        }
        let outcome = outcome?;
        let end = Arc::new(outcome.end.clone());
        self.recent.put(ENDS, &end_key(ready, course), Arc::clone(&end), end.bytes());
        Ok(outcome)
    }
}
