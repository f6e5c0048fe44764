use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;

use super::compare::Reference;
use super::report::{Ingredients, compile, step_documents};
use super::solve_watch::{Beginning, FinishedStep, SolveWatch};
use super::{Context, Done, changed_meanwhile, scene, to_json};
use crate::requests::{SolveKind, SolveRequest};
use crate::running::{Phase, step_warning};
use crate::service::warning_event;
use prosopon_planning::simulate::Outcome;
use prosopon_session::{Fault, Halt, MeshDocument, Run, SessionParts, StoredMilestone, key_of, stored_cuts};
use prosopon_store::{PartKind, StepRecord, StoreError, encode_mesh};
use prosopon_tissue::mesh::MeshReport;

/// Share of the computation's progress that the steps take.
const SOLVING: f64 = 0.98;

/// Result of the computation on the pool.
struct Solved {
    outcome: Outcome,
    tissue: Option<Vec<u8>>,
    solving: Duration,
    mesh: Option<(MeshReport, f64)>,
    regions_from_landmarks: bool,
    warnings: Vec<String>,
}

/// Solves along the plan; each step is stored as soon as it is solved.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    match context.request::<SolveKind>()?.ready {
        Some(_) => scene::perform(context, &context.request()?).await,
        None => on_case(context, context.request()?).await,
    }
}

async fn on_case(context: &Context, request: SolveRequest) -> Result<Done, Halt> {
    let parts = context.parts().await?;
    let tissue = parts.tissue_request(&request.mesh.settings, request.mesh.cuts.as_deref())?;
    if tissue.key != request.mesh_key {
        return Err(changed_meanwhile().into());
    }
    let store = &context.service.store;
    let case = context.case(&parts).await?;
    let rest = context.put(encode_mesh(&case.anatomy.skin)).await?;
    context.service.persist(|| store.set_rest(&context.job, &rest)).await?;
    let reference = context.unless_stopped(Reference::load(context, &parts, &request)).await?;
    let settings = request.settings(&case.anatomy.skull)?;
    let after = request.warm_start.as_ref().map(|before| before.earlier()).transpose()?.map(Box::new);
    let compared = compared_with(&parts);
    let before = milestone(context, &compared).await?;
    let (cuts, plan) = (stored_cuts(&request.cuts)?, request.plan.plan()?);
    let goes_on = before.as_ref().map(|before| before.milestone.clone());
    let run = Run { case, cuts, tissue, plan, settings, after, milestone: goes_on };

    let (sender, receiver) = mpsc::channel(2);
    let beginning = Beginning { before, compared };
    let computing = compute(context, run, request.tissue, reference, beginning, sender);
    let (solved, written) = tokio::join!(computing, write_steps(context, receiver));
    // A failed write cancels the solver, so report the reason of the write.
    written?;
    let solved = solved.map_err(|halt| context.cuts_of(Some(request.osteotomy_id), "/plan", halt))?;

    context.running.set_phase(Phase::Writing);
    let steps = context.all_steps().await?;
    let tissue = match solved.tissue {
        Some(file) => Some(context.put(file).await?),
        None => None,
    };
    let mut warnings = solved.outcome.warnings.clone();
    warnings.extend(solved.warnings.iter().cloned());
    let mesh_s = match (parts.get(PartKind::Mesh), &solved.mesh) {
        (Some(part), _) if part.key == request.mesh_key => part.wall_s,
        (_, Some((_, wall_s))) => *wall_s,
        (_, None) => 0.0,
    };
    let osteotomy = request.mesh.cuts.is_some().then(|| request.osteotomy_id.to_string());
    let ingredients = Ingredients {
        mesh: solved.mesh.map(|(report, _)| MeshDocument::new(request.mesh.settings, osteotomy, &report)),
        mesh_s,
        job: &context.job,
        request: &request,
        parts: &parts,
        outcome: &solved.outcome,
        steps: &steps,
        regions_from_landmarks: solved.regions_from_landmarks,
        solve_s: solved.solving.as_secs_f64(),
        warnings: &warnings,
        told: &context.running.own_warnings(),
    };
    Ok(Done { report: Some(to_json(&compile(&ingredients)?)?), tissue, warnings })
}

async fn compute(
    context: &Context,
    run: Run,
    tissue: bool,
    reference: Option<Reference>,
    beginning: Beginning,
    steps: mpsc::Sender<FinishedStep>,
) -> Result<Solved, Halt> {
    let running = Arc::clone(&context.running);
    context
        .compute(move |engine, control| {
            let (mut regions, regions_from_landmarks) = engine.regions(&run.case);
            if reference.is_none() {
                regions.clear();
            }
            let in_face = |p| regions.iter().any(|r| r.bounds.contains(p));
            let mask = run.case.anatomy.skin.positions().iter().map(in_face).collect();
            let cancel = control.stage(0.0, 0.0);
            let watch = SolveWatch::new(engine, cancel, running, steps, beginning);
            let mut watch = SolveWatch { reference, regions, mask, ..watch };
            let outcome = engine.solve(&run, &control.stage(0.0, SOLVING), &mut watch)?;
            let solving = watch.solving + watch.step_began.elapsed();
            let (warnings, mesh) = (watch.warnings, watch.mesh);
            let tissue =
                tissue.then(|| engine.tissue_file(&run, &outcome.nodes, &control.stage(SOLVING, 1.0))).transpose()?;
            Ok(Solved { outcome, tissue, solving, mesh, regions_from_landmarks, warnings })
        })
        .await
}

/// Key of the target and the landmarks, which error maps depend on.
///
/// Both may be replaced while a job waits.
fn compared_with(parts: &SessionParts) -> String {
    key_of(&[PartKind::Target, PartKind::Landmarks].map(|kind| parts.get(kind).map_or("", |part| part.key.as_str())))
}

/// The checkpoint of an earlier attempt.
///
/// An unusable checkpoint is deleted with the steps before it, because these may come from other inputs than later steps.
pub(super) async fn milestone(context: &Context, compared: &str) -> Result<Option<StoredMilestone>, Halt> {
    let Some(key) = &context.job.milestone_blob else { return Ok(None) };
    let before = usable(context, key, compared).await?;
    if before.is_none() {
        let store = &context.service.store;
        context.service.persist(|| store.begin_again(&context.job)).await?;
    }
    Ok(before)
}

async fn usable(context: &Context, key: &str, compared: &str) -> Result<Option<StoredMilestone>, Halt> {
    let store = &context.service.store;
    let read = async {
        match store.blobs().get(key).await {
            Err(StoreError::BlobGone { .. } | StoreError::BucketRefused(_) | StoreError::Damaged { .. }) => Ok(None),
            read => read.map(Some),
        }
    };
    let bytes = context.unless_stopped(read).await?;
    let Some(before) = bytes.and_then(|bytes| StoredMilestone::decode(&bytes)) else {
        tracing::warn!(
            key,
            "the job's checkpoint is missing, damaged or of another version; all steps are solved again"
        );
        return Ok(None);
    };
    if before.compared != compared {
        tracing::info!("the target or the landmarks were replaced; all steps are solved again");
        return Ok(None);
    }
    let steps = step_documents(&store.steps(context.job.id).await?)?;
    let k = before.milestone.k as u32;
    if !(1..context.job.steps).contains(&k) || !steps.iter().map(|step| step.k).take_while(|n| *n <= k).eq(1..=k) {
        tracing::warn!(step = k, found = steps.len(), "steps before the checkpoint are missing; all steps are solved again");
        return Ok(None);
    }
    // Later steps are solved again and report their warnings then.
    for step in steps.iter().take_while(|step| step.k <= k) {
        step.warnings.iter().for_each(|warning| context.running.warn_of_step(step.k, warning));
    }
    metrics::counter!("prosopon_jobs_resumed_total").increment(1);
    tracing::info!(step = before.milestone.k, steps = context.job.steps, "the job continues from its checkpoint");
    Ok(Some(before))
}

/// Stores steps as they arrive: the frame first, then the row that makes it visible.
pub(super) async fn write_steps(context: &Context, mut steps: mpsc::Receiver<FinishedStep>) -> Result<(), Halt> {
    let mut first_failure = Ok(());
    while let Some(step) = steps.recv().await {
        if first_failure.is_err() {
            continue;
        }
        first_failure = write_step(context, step).await;
        if first_failure.is_err() {
            context.running.control.cancel();
        }
    }
    first_failure
}

async fn write_step(context: &Context, step: FinishedStep) -> Result<(), Halt> {
    let FinishedStep { document, error, frame, milestone } = step;
    let store = &context.service.store;
    let frame = context.put(frame).await?;
    let mut event = serde_json::to_value(&document).map_err(internal)?;
    if let Some(members) = event.as_object_mut() {
        members.insert("steps".to_owned(), context.job.steps.into());
        members.insert("has_error".to_owned(), error.is_some().into());
    }
    let record = StepRecord {
        k: document.k,
        t: document.t,
        document: to_json(&document)?,
        error: error.as_ref().map(to_json).transpose()?,
        blob: frame.key.clone(),
        sha256: frame.sha256.clone(),
        bytes: frame.bytes,
    };
    let mut events: Vec<_> = document.warnings.iter().map(|w| warning_event(&step_warning(document.k, w))).collect();
    events.push(("step", event.to_string()));
    context.service.persist(|| store.commit_step(&context.job, &record, &events)).await?;
    tracing::info!(step = document.k, steps = context.job.steps, duration_s = document.wall_s, "step stored");
    for warning in &document.warnings {
        context.running.warn_of_step(document.k, warning);
    }
    context.service.announce();
    // The job does not need the checkpoint, and a failure of the store shows at the next step.
    if let Some(milestone) = milestone
        && let Err(halt) = keep_milestone(context, milestone).await
    {
        tracing::warn!(?halt, "a checkpoint could not be stored");
    }
    Ok(())
}

async fn keep_milestone(context: &Context, milestone: Vec<u8>) -> Result<(), Halt> {
    let milestone = context.put(milestone).await?;
    let store = &context.service.store;
    Ok(context.service.persist(|| store.set_milestone(&context.job, &milestone)).await?)
}

fn internal(error: serde_json::Error) -> Fault {
    tracing::error!(%error, "a document cannot be written");
    Fault::new(prosopon_session::FaultKind::Internal, "a document cannot be written; see the log of the service")
}
