//! The skin at the end of an operation's path, with the settings of the service.

use std::time::Instant;

use super::head::Head;
use super::model_case::clock;
use super::operations::{self, Operation, Scene};
use prosopon_geometry::Vector;
use prosopon_geometry::control::Control;
use prosopon_planning::simulate::{AttachmentRules, HEAD_LOCKING, LEAVE_OUT_BELOW_MM, RunSettings, solve};
use prosopon_tissue::fem::{Model, Preset, SolveSettings};

/// The movement of the skin, or why there is none.
pub(super) struct EndSkin {
    /// Displacement of each vertex of the head's skin, mm.
    pub(super) moved: Result<Vec<Vector>, String>,
    pub(super) solve_s: f64,
    /// Counts of the solve in words, or why there is none.
    pub(super) detail: String,
}

impl EndSkin {
    pub(super) fn missing(why: String) -> Self {
        Self { moved: Err(why.clone()), solve_s: 0.0, detail: why }
    }
}

/// The defaults of the service.
pub(super) fn usual_run(steps: usize) -> RunSettings {
    let materials = Preset::Wang2009Stable.materials();
    RunSettings {
        solver: SolveSettings { locking: HEAD_LOCKING, ..SolveSettings::new(Model::Nonlinear, materials) },
        steps,
        attachment: Some(AttachmentRules::default()),
        leave_out_below_mm: LEAVE_OUT_BELOW_MM,
    }
}

/// Solves the operation on the scene within `limit_s` seconds.
pub(super) fn end_skin(
    head: &Head,
    scene: &Scene,
    operation: &Operation,
    settings: &RunSettings,
    limit_s: f64,
) -> EndSkin {
    let plan = match operations::plan(&scene.bone, &operation.moves, &head.landmarks) {
        Ok(plan) => plan,
        Err(why) => return EndSkin::missing(why),
    };
    let control = Control::new().with_clock(clock).with_deadline(clock() + limit_s);
    let begin = Instant::now();
    let mut last = None;
    let outcome =
        solve(&head.anatomy, &scene.tissue, &scene.bone, &plan, settings, &control, &mut |frame| last = Some(frame));
    let solve_s = begin.elapsed().as_secs_f64();
    match (outcome, last) {
        (Ok(outcome), Some(frame)) => {
            let rest = head.anatomy.skin.positions();
            let moved = frame.skin.positions().iter().zip(rest).map(|(a, b)| a - b).collect();
            let iterations: usize = outcome.steps.iter().map(|s| s.newton_iterations).sum();
            let a = &outcome.attached;
            let glide: usize = a.gliding.values().sum();
            let detail = format!(
                "({iterations} iterations, {} unknowns; {glide} gliding, {} sliding, {} free)",
                frame.report.unknowns, a.sliding, a.free_at_bone
            );
            EndSkin { moved: Ok(moved), solve_s, detail }
        }
        (Err(error), _) => EndSkin { solve_s, ..EndSkin::missing(error.to_string()) },
        (Ok(_), None) => EndSkin { solve_s, ..EndSkin::missing("no step".to_owned()) },
    }
}
