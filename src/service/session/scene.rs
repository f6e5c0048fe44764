//! Solves with an uploaded tissue mesh.

use std::sync::Arc;

use super::{RunWatch, SceneRun, SceneSolved};
use prosopon_contract::{Fault, FaultKind, Halt};
use prosopon_field::SignedField;
use prosopon_formats::export::vtu_of_mesh;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, Warning};
use prosopon_planning::simulate::{Frame, OuterSurface, ReadyMesh, Scene};
use prosopon_tissue::fem::{SolveError, StepReport};

/// Builds the fields of uploaded bones by segment, with warnings about repairs.
pub(super) fn bone_fields(
    surfaces: &[(u32, TriMesh)],
    run: &SceneRun,
    control: &Control,
) -> Result<(Vec<(u32, Arc<SignedField>)>, Vec<Warning>), Halt> {
    let (mut fields, mut warnings) = (Vec::new(), Vec::new());
    let n = surfaces.len() as f64;
    for (index, (segment, surface)) in surfaces.iter().enumerate() {
        let part = control.stage(index as f64 / n, (index + 1) as f64 / n);
        let (field, _, found) = SignedField::build_only(surface, &run.fields.field, &part)?;
        warnings.extend(found.into_iter().map(|w| w.about(format_args!("bone {segment}"))));
        fields.push((*segment, Arc::new(field)));
    }
    Ok((fields, warnings))
}

/// Solves the mesh with the fields of the bones.
pub(super) fn solve_scene(
    run: &SceneRun,
    bones: Vec<(u32, Arc<SignedField>)>,
    control: &Control,
    watch: &mut dyn RunWatch,
) -> Result<SceneSolved, Halt> {
    let unusable = |detail: String| Halt::from(Fault::new(FaultKind::MeshNotUsable, detail).at("tissue"));
    let ready = ReadyMesh::new(&run.volume).map_err(|e| unusable(e.to_string()))?;
    let outside = OuterSurface::of(&ready).map_err(|e| unusable(e.to_string()))?;
    let scene = Scene { ready, bones, plan: run.plan.clone(), settings: run.solver.clone(), steps: run.steps };
    for warning in scene.settings.stability_warnings(&scene.ready.mesh) {
        watch.warning(warning);
    }
    watch.stage("solve");
    let mut solve = |after| {
        scene.solve_with_steps(after, control, &mut |k, nodes, report, checkpoint| {
            if let Some(frame) = frame(&outside, k, run.steps, nodes, report) {
                watch.frame(frame, checkpoint);
            }
        })
    };
    let outcome = match solve(run.checkpoint.as_ref()) {
        Err(SolveError::Checkpoint { detail }) => {
            tracing::warn!(detail, "the checkpoint does not match this job; all steps are solved again");
            solve(None)
        }
        solved => solved,
    }?;
    if let Some(failure) = outcome.failure {
        return Err(failure.into());
    }
    let file = run.file.then(|| vtu_of_mesh(&scene.solved_mesh(&run.volume, &outcome)));
    Ok(SceneSolved { file, warnings: outcome.warnings })
}

/// The frame of a step; `None` when a position is not finite, which no equilibrium has.
fn frame(outside: &OuterSurface, k: usize, steps: usize, nodes: &[Point], report: &StepReport) -> Option<Frame> {
    let skin = outside.at(nodes).ok()?;
    let rest = outside.rest.positions();
    let displacement_mm = skin.positions().iter().zip(rest).map(|(x, rest)| (x - rest).norm() as f32).collect();
    Some(Frame { k, t: k as f64 / steps as f64, skin, displacement_mm, report: report.clone() })
}
