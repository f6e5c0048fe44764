use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;

use super::report::{inputs, step_documents, step_warnings};
use super::solve_watch::{Beginning, FinishedStep, SolveWatch};
use super::steps::{checkpoint, write_steps};
use super::{Context, Done, changed_meanwhile};
use crate::requests::SceneTask;
use crate::running::Phase;
use prosopon_contract::{
    Fault, FaultKind, Findings, Halt, PhasesDocument, ReportDocument, WarningDocument, import_fault, stored_cuts,
    to_json,
};
use prosopon_formats::import::volume_mesh;
use prosopon_planning::simulate::{OuterSurface, READY_MESH_LOCKING, ReadyMesh};
use prosopon_session::{SceneBones, SceneRun, SceneSolved, SessionParts, load_mesh, read_part};
use prosopon_store::{PartKind, encode_mesh, now_rfc3339};

/// Solves an uploaded tissue mesh along the plan; each step is stored as soon as it is solved.
pub(super) async fn perform(context: &Context, request: &SceneTask) -> Result<Done, Halt> {
    let parts = context.parts().await?;
    let tissue = parts.require(PartKind::Tissue)?;
    if tissue.key != request.ready.sha256 {
        return Err(changed_meanwhile().into());
    }
    let store = &context.service.store;
    let bytes = context.unless_stopped(read_part(store, tissue)).await?;
    let bones = bones(context, &parts, request).await?;
    let limits = context.service.settings.import;
    let read = context.compute(move |_, _| {
        let unusable = |detail: String| Halt::from(Fault::new(FaultKind::MeshNotUsable, detail));
        let (volume, _) = volume_mesh(&bytes, &limits).map_err(|e| import_fault(&e, FaultKind::MeshNotUsable))?;
        let ready = ReadyMesh::new(&volume).map_err(|e| unusable(e.to_string()))?;
        let outside = OuterSurface::of(&ready).map_err(|e| unusable(e.to_string()))?;
        Ok((volume, encode_mesh(&outside.rest)))
    });
    let (volume, rest) = read.await?;
    let rest = context.put(rest).await?;
    context.service.persist(|| store.set_rest(&context.job, &rest)).await?;
    // The steps of a scene have no reference.
    let compared = String::new();
    let before = checkpoint(context, &compared).await?;
    let run = SceneRun {
        volume,
        bones,
        fields: (&request.field_settings).into(),
        plan: request.plan.plan()?,
        solver: request.request.options().settings(READY_MESH_LOCKING),
        steps: request.request.steps() as usize,
        file: request.request.wants_tissue(),
        checkpoint: before.as_ref().map(|before| before.checkpoint.clone()),
    };

    let (sender, receiver) = mpsc::channel(2);
    let beginning = Beginning { before, compared };
    let (solved, written) = tokio::join!(compute(context, run, beginning, sender), write_steps(context, receiver));
    // A failed write cancels the solver, so report the reason of the write.
    written?;
    let (solved, solving) = solved.map_err(|halt| context.cuts_of(request.osteotomy_id, "/plan", halt))?;

    context.running.set_phase(Phase::Writing);
    let report = report(context, &parts, request, &solved, solving).await?;
    let tissue = match solved.file {
        Some(file) => Some(context.put(file).await?),
        None => None,
    };
    let mut reported = context.running.own_warnings();
    reported.extend(context.running.step_warnings().into_iter().map(|(_, warning)| warning));
    let found = solved.warnings.into_iter().map(WarningDocument::from);
    let warnings = found.filter(|w| !reported.contains(w)).collect();
    Ok(Done { report: Some(to_json("the report", &report)?), tissue, warnings, continuation: None })
}

/// The segments of the plan's osteotomy, or the uploaded bones when the plan has none.
async fn bones(context: &Context, parts: &SessionParts, request: &SceneTask) -> Result<SceneBones, Halt> {
    if let Some(cuts) = &request.cuts {
        let case = Box::new(context.case(parts).await?);
        if case.key != request.field_key {
            return Err(changed_meanwhile().into());
        }
        return Ok(SceneBones::Cut { case, cuts: stored_cuts(cuts)? });
    }
    let mut surfaces = Vec::new();
    for (segment, part) in parts.bones() {
        surfaces.push((segment, context.unless_stopped(load_mesh(&context.service.store, part)).await?));
    }
    if request.bones != parts.bone_keys() {
        return Err(changed_meanwhile().into());
    }
    Ok(SceneBones::Surfaces(surfaces))
}

async fn compute(
    context: &Context,
    run: SceneRun,
    beginning: Beginning,
    steps: mpsc::Sender<FinishedStep>,
) -> Result<(SceneSolved, Duration), Halt> {
    let running = Arc::clone(&context.running);
    context
        .compute(move |engine, control| {
            let mut watch = SolveWatch::new(engine, control.stage(0.0, 0.0), running, steps, beginning);
            let solved = engine.solve_scene(&run, control, &mut watch)?;
            Ok((solved, watch.solving + watch.step_began.elapsed()))
        })
        .await
}

async fn report(
    context: &Context,
    parts: &SessionParts,
    request: &SceneTask,
    solved: &SceneSolved,
    solving: Duration,
) -> Result<ReportDocument, Halt> {
    let steps = step_documents(&context.all_steps().await?)?;
    let reported = context.running.own_warnings();
    let mut findings: Findings = reported.iter().cloned().collect();
    // The scene also returns the warnings of its steps, which the report lists with the step numbers.
    let of_steps = |w: &WarningDocument| steps.iter().any(|step| step.findings.iter().any(|s| s == w));
    let solved = solved.warnings.iter().cloned().map(WarningDocument::from);
    let others = solved.chain(request.cut_warnings.iter().chain(request.ready.findings.iter()).cloned());
    findings.extend(others.filter(|w| !of_steps(w)));
    findings.extend(step_warnings(&steps, &reported));
    let solve_s = solving.as_secs_f64();
    let solve = &request.request;
    let mut parameters = solve.options().parameters();
    for (name, value) in [
        ("steps", serde_json::json!(solve.steps())),
        ("plan", serde_json::json!(solve.plan)),
        ("osteotomy", serde_json::json!(request.osteotomy_id)),
        ("cuts", serde_json::json!(request.cuts)),
    ] {
        parameters.insert(name.to_owned(), value);
    }
    Ok(ReportDocument {
        format_version: 1,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        job: context.job.id.to_string(),
        session: context.job.session.to_string(),
        finished_at: now_rfc3339(),
        attempt: context.job.attempt,
        model: solve.solved_model().as_str().to_owned(),
        parameters: parameters.into(),
        inputs: inputs(parts)?,
        phases: PhasesDocument { solve_s, total_s: solve_s, ..PhasesDocument::default() },
        field: None,
        mesh: None,
        tissue: Some(request.ready.clone()),
        budget: None,
        plan: request.plan.clone(),
        segment_names: request.segment_names.clone(),
        steps,
        left_out: None,
        attached: None,
        regions: BTreeMap::new(),
        clinical: None,
        error: None,
        regions_from_landmarks: false,
        frame: None,
        unconfirmed_landmarks: Vec::new(),
        findings,
    })
}
