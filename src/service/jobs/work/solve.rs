use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::compare::Reference;
use super::continuation::{Spent, go_on};
use super::estimate::Estimating;
use super::report::{Ingredients, compile};
use super::solve_watch::{Beginning, FinishedStep, SolveWatch};
use super::steps::{checkpoint, write_steps};
use super::{Context, Done, changed_meanwhile, scene};
use crate::requests::{MeshChoice, SolveKind, SolveTask};
use crate::running::Phase;
use crate::tasks::{input_warnings, measured};
use prosopon_contract::{
    BudgetDocument, FrameDocument, Halt, MeshDocument, MeshRequest, MouthDocument, PresetName, TissueLawsDocument,
    WarningDocument, stored_cuts, to_json,
};
use prosopon_geometry::Warning;
use prosopon_planning::evaluate::Clinical;
use prosopon_planning::simulate::Outcome;
use prosopon_planning::simulate::budget::COARSER;
use prosopon_session::{Kept, Run, SessionParts, key_of};
use prosopon_store::{PartKind, encode_mesh};
use prosopon_tissue::mesh::MeshReport;

/// Share of the computation's progress that the steps take.
const SOLVING: f64 = 0.98;
/// The same when the error is estimated afterwards.
const BEFORE_ESTIMATE: f64 = 0.7;

/// Result of the computation on the pool.
struct Solved {
    outcome: Outcome,
    tissue: Option<Vec<u8>>,
    solving: Duration,
    mesh: Option<(MeshReport, f64)>,
    regions_from_landmarks: bool,
    frame: FrameDocument,
    clinical: Option<Clinical>,
    budget: Option<BudgetDocument>,
    warnings: Vec<WarningDocument>,
}

/// Solves along the plan; each step is stored as soon as it is solved.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    match context.request::<SolveKind>()?.ready {
        Some(_) => scene::perform(context, &context.request()?).await,
        None => Box::pin(on_case(context, context.request()?)).await,
    }
}

async fn on_case(context: &Context, request: SolveTask) -> Result<Done, Halt> {
    let parts = context.parts().await?;
    let tissue = parts.tissue_request(&request.mesh.settings, request.mesh.cuts.as_deref())?;
    if tissue.key != request.mesh_key {
        return Err(changed_meanwhile().into());
    }
    let store = &context.service.store;
    let case = context.case(&parts).await?;
    context.recall(&parts, Kept::Tissue, &tissue.key).await?;
    let reference = context.unless_stopped(Reference::load(context, &parts, &request)).await?;
    let settings = request.settings(&case.anatomy.skull)?;
    let after = request.warm_start.as_ref().map(|before| before.earlier()).transpose()?.map(Box::new);
    let compared = compared_with(&parts);
    let before = checkpoint(context, &compared).await?;
    let (cuts, plan) = (stored_cuts(&request.cuts)?, request.plan.plan()?);
    let unmeasured = (!request.plan.measured).then(|| (case.clone(), cuts.clone(), request.plan.clone()));
    let goes_on = before.as_ref().map(|before| before.checkpoint.clone());
    let run = Run { case, cuts, tissue, plan, settings, after, checkpoint: goes_on };
    let running = Arc::clone(&context.running);
    let (run, rest, beforehand) = context
        .compute(move |engine, control| {
            input_warnings(engine, &run.case)?.into_iter().for_each(|found| running.warn(found.into()));
            let (was_built, begin) = (engine.has(Kept::Tissue, &run.tissue.key), Instant::now());
            let rest = encode_mesh(&engine.skin(&run, &control.without_progress())?);
            Ok((run, rest, Beforehand { was_built, mesh_s: begin.elapsed().as_secs_f64() }))
        })
        .await
        .map_err(|halt| context.cuts_of(Some(request.osteotomy_id), "/plan", halt))?;
    let rest = context.put(rest).await?;
    context.service.persist(|| store.set_rest(&context.job, &rest)).await?;

    let estimating = request.budget.clone().map(|budget| estimating(&parts, &request, budget)).transpose()?;

    let (sender, receiver) = mpsc::channel(2);
    let beginning = Beginning { before, compared };
    let extras = Extras { tissue: request.request.wants_tissue(), beforehand, reference, estimating };
    let computing = compute(context, run, extras, beginning, sender);
    let (solved, written) = tokio::join!(computing, write_steps(context, receiver));
    // A failed write cancels the solver, so report the reason of the write.
    written?;
    let solved = solved.map_err(|halt| context.cuts_of(Some(request.osteotomy_id), "/plan", halt))?;

    // After the path, so that no skin waits for it.
    let request = match unmeasured {
        Some((case, cuts, plan)) => {
            let measuring = context
                .compute(move |engine, control| measured(engine, &case, &cuts, plan, &control.without_progress()));
            SolveTask { plan: measuring.await?, ..request }
        }
        None => request,
    };
    context.running.set_phase(Phase::Writing);
    let steps = context.all_steps().await?;
    let tissue = match solved.tissue {
        Some(file) => Some(context.put(file).await?),
        None => None,
    };
    let mut warnings: Vec<WarningDocument> = solved.outcome.warnings.iter().cloned().map(Into::into).collect();
    warnings.extend(solved.warnings.iter().cloned());
    if request.request.materials.cartilage.is_some() && !request.mesh.settings.cartilage {
        let message = "materials.cartilage was not used: the mesh has no cartilage";
        let action = "Build the mesh with `cartilage: true`, or leave the material out.";
        warnings.push(Warning::check("material-not-used", message).act(action).into());
    }
    let mesh_s = match (parts.get(PartKind::Mesh), &solved.mesh) {
        (Some(part), _) if part.key == request.mesh_key && beforehand.was_built => part.wall_s,
        (_, Some((_, wall_s))) => *wall_s,
        (_, None) => 0.0,
    };
    let mut budget = solved.budget;
    let continuation = match (&mut budget, &solved.mesh) {
        (Some(budget), Some((report, _))) => {
            let spent = Spent { nodes: report.nodes, mesh_s, path_s: solved.solving.as_secs_f64() };
            go_on(context, &parts, &request, budget, spent)?
        }
        _ => None,
    };
    let continuation = continuation.and_then(|(job, note)| {
        if let Some(next) = &job {
            let action = format!("Use the result of job {}, which goes on with a better setting.", next.0.id);
            let missed = warnings.iter_mut().filter(|w| w.code == "budget-missed");
            missed.for_each(|w| w.action = Some(action.clone()));
        }
        warnings.push(note.into());
        job
    });
    let osteotomy = request.mesh.cuts.is_some().then(|| request.osteotomy_id.to_string());
    let ingredients = Ingredients {
        mesh: solved.mesh.map(|(report, _)| MeshDocument::new(request.mesh.settings.clone(), osteotomy, &report)),
        mesh_s,
        job: &context.job,
        request: &request,
        parts: &parts,
        outcome: &solved.outcome,
        steps: &steps,
        regions_from_landmarks: solved.regions_from_landmarks,
        frame: solved.frame,
        clinical: solved.clinical.as_ref(),
        solve_s: solved.solving.as_secs_f64(),
        budget,
        warnings: &warnings,
        reported: &context.running.own_warnings(),
    };
    let report = Some(to_json("the report", &compile(&ingredients)?)?);
    Ok(Done { report, tissue, warnings, continuation })
}

/// The tissue mesh before the path: where lips part, the skin at rest needs it.
#[derive(Debug, Clone, Copy)]
struct Beforehand {
    /// Whether it was at hand.
    was_built: bool,
    /// Time until the skin at rest was known, s.
    mesh_s: f64,
}

/// What is computed besides the steps.
struct Extras {
    /// Whether the deformed tissue is kept.
    tissue: bool,
    beforehand: Beforehand,
    reference: Option<Reference>,
    estimating: Option<Estimating>,
}

/// The budget with the coarser mesh by which its error is estimated.
fn estimating(parts: &SessionParts, request: &SolveTask, budget: BudgetDocument) -> Result<Estimating, Halt> {
    let MeshChoice { settings, cuts } = &request.mesh;
    let coarser = MeshRequest { edge_mm: COARSER * settings.edge_mm, ..settings.clone() };
    let solve = &request.request;
    let unlike = [
        (solve.preset.unwrap_or_default() != PresetName::default(), "a preset"),
        (solve.materials != TissueLawsDocument::default(), "materials"),
        (solve.attachment.is_some(), "an attachment"),
        (settings.mouth != MouthDocument::default(), "a mouth"),
        (settings.cartilage, "cartilage"),
    ];
    let unlike = unlike.into_iter().filter_map(|(is_so, name)| is_so.then_some(name)).collect();
    Ok(Estimating { budget, coarser: parts.tissue_request(&coarser, cuts.as_deref())?, unlike })
}

async fn compute(
    context: &Context,
    run: Run,
    Extras { tissue, beforehand, reference, estimating }: Extras,
    beginning: Beginning,
    steps: mpsc::Sender<FinishedStep>,
) -> Result<Solved, Halt> {
    let running = Arc::clone(&context.running);
    context
        .compute(move |engine, control| {
            let (mut regions, regions_from_landmarks) = engine.regions(&run.case, &control.without_progress())?;
            let frame = FrameDocument::from(&engine.frame(&run.case, control)?);
            if reference.is_none() {
                regions.clear();
            }
            let in_face = |p| regions.iter().any(|r| r.contains(p));
            let skin = engine.skin(&run, &control.without_progress())?;
            let mask = skin.positions().iter().map(in_face).collect();
            let cancel = control.stage(0.0, 0.0);
            let watch = SolveWatch::new(engine, cancel, Arc::clone(&running), steps, beginning);
            let mut watch = SolveWatch { reference, regions, mask, run: Some(&run), ..watch };
            let solved = if estimating.is_some() { BEFORE_ESTIMATE } else { SOLVING };
            let outcome = engine.solve(&run, &control.stage(0.0, solved), &mut watch)?;
            let solving = watch.solving + watch.step_began.elapsed();
            let mesh = watch.mesh.map(|(report, wall_s)| (report, beforehand.mesh_s + wall_s));
            let mut warnings = watch.warnings;
            let last = watch.last.as_ref();
            let clinical = match last.map(|skin| engine.clinical(&run, skin, &control.stage(solved, solved))) {
                Some(Ok(clinical)) => {
                    let found = clinical.joined_lips().into_iter().chain(clinical.points_off_surface());
                    warnings.extend(found.map(WarningDocument::from));
                    Some(clinical)
                }
                Some(Err(Halt::Cancelled)) => return Err(Halt::Cancelled),
                Some(Err(Halt::Fault(fault))) => {
                    let message = format!("named points and the profile could not be measured: {}", fault.detail);
                    let action = "Check the skin and the landmarks.";
                    warnings.push(Warning::check("points-not-measured", message).act(action).into());
                    None
                }
                None => None,
            };
            let budget = match estimating {
                Some(estimating) => {
                    running.set_phase(Phase::Estimate);
                    let mesh_s = mesh.as_ref().map_or(0.0, |(_, wall_s)| *wall_s);
                    let control = control.stage(solved, SOLVING);
                    let (budget, found) =
                        estimating.finish(engine, &run, last, [mesh_s, solving.as_secs_f64()], &control)?;
                    warnings.extend(found.into_iter().map(WarningDocument::from));
                    Some(budget)
                }
                None => None,
            };
            let tissue =
                tissue.then(|| engine.tissue_file(&run, &outcome, &control.stage(SOLVING, 1.0))).transpose()?;
            Ok(Solved { outcome, tissue, solving, mesh, regions_from_landmarks, frame, clinical, budget, warnings })
        })
        .await
}

/// Key of the target, the landmarks and the frame, which error maps depend on.
///
/// Both may be replaced while a job waits.
fn compared_with(parts: &SessionParts) -> String {
    key_of(
        &[PartKind::Target, PartKind::Landmarks, PartKind::Frame]
            .map(|kind| parts.get(kind).map_or("", |part| part.key.as_str())),
    )
}
