use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use crate::requests::SolveTask;
use crate::running::step_warning;
use prosopon_contract::{
    BudgetDocument, ClinicalDocument, CtDocument, ErrorDocument, Fault, FieldDocument, Findings, FrameDocument,
    MeshDocument, PhasesDocument, ReportDocument, ReportInput, StepDocument, SurfaceDocument, WarningDocument,
    from_json,
};
use prosopon_geometry::Warning;
use prosopon_planning::evaluate::Clinical;
use prosopon_planning::simulate::Outcome;
use prosopon_session::SessionParts;
use prosopon_store::{JobRecord, PartKind, StepRecord, now_rfc3339};

/// Inputs of a report.
#[derive(Debug)]
pub(super) struct Ingredients<'a> {
    pub(super) job: &'a JobRecord,
    pub(super) request: &'a SolveTask,
    pub(super) parts: &'a SessionParts,
    pub(super) outcome: &'a Outcome,
    pub(super) steps: &'a [StepRecord],
    pub(super) mesh: Option<MeshDocument>,
    /// Computing time of the mesh, s.
    pub(super) mesh_s: f64,
    pub(super) regions_from_landmarks: bool,
    pub(super) frame: FrameDocument,
    pub(super) clinical: Option<&'a Clinical>,
    pub(super) solve_s: f64,
    /// What was chosen for a budget, with what it cost.
    pub(super) budget: Option<BudgetDocument>,
    pub(super) warnings: &'a [WarningDocument],
    /// Warnings from before the first step.
    pub(super) reported: &'a [WarningDocument],
}

pub(super) fn compile(i: &Ingredients<'_>) -> Result<ReportDocument, Fault> {
    let field: FieldDocument = i.parts.require_field()?;
    let steps = step_documents(i.steps)?;
    let error = i.steps.last().and_then(|s| s.error.as_deref()).map(read::<ErrorDocument>).transpose()?;
    let mut findings: Findings = i.reported.iter().chain(i.warnings).cloned().collect();
    findings.extend(field.findings.iter().chain(&i.request.cut_warnings).cloned());
    findings.extend(i.request.plan.findings.iter().cloned());
    findings.extend(i.mesh.iter().flat_map(|mesh| mesh.findings.iter().cloned()));
    findings.extend(step_warnings(&steps, i.reported));
    findings.extend(error.iter().flat_map(|e| e.findings.iter().map(|w| w.about("error map"))));
    let unconfirmed_landmarks = unconfirmed(i.parts)?;
    let midline_given = i.parts.landmarks()?.is_some_and(|landmarks| landmarks.midline_x_mm.is_some());
    let clinical = i
        .clinical
        .map(|c| ClinicalDocument::new(c, &i.frame.motion().inverse(), &unconfirmed_landmarks, midline_given));
    findings.extend(unconfirmed_warning(&unconfirmed_landmarks));
    Ok(ReportDocument {
        format_version: 1,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        job: i.job.id.to_string(),
        session: i.job.session.to_string(),
        finished_at: now_rfc3339(),
        attempt: i.job.attempt,
        model: i.request.request.solved_model().as_str().to_owned(),
        parameters: parameters(i.request).into(),
        inputs: inputs(i.parts)?,
        phases: phases(i),
        field: Some(field),
        mesh: i.mesh.clone(),
        tissue: None,
        budget: i.budget.clone(),
        plan: i.request.plan.clone(),
        segment_names: i.request.segment_names.clone(),
        steps,
        left_out: (i.outcome.left_out.nodes > 0).then(|| i.outcome.left_out.into()),
        attached: Some((&i.outcome.attached).into()),
        regions: i.outcome.regions.iter().map(|r| (r.name.to_owned(), r.into())).collect(),
        clinical,
        error,
        regions_from_landmarks: i.regions_from_landmarks,
        frame: Some(i.frame.clone()),
        unconfirmed_landmarks,
        findings,
    })
}

/// Landmarks of the session that are still proposals.
fn unconfirmed(parts: &SessionParts) -> Result<Vec<String>, Fault> {
    Ok(parts.landmarks()?.map(|landmarks| landmarks.proposed).unwrap_or_default())
}

fn unconfirmed_warning(names: &[String]) -> Option<Warning> {
    (!names.is_empty()).then(|| {
        let message = format!("these landmarks were proposed and are not confirmed: {}", names.join(", "));
        Warning::check("unconfirmed-landmarks", message).act("Check them, since measurements depend on them.")
    })
}

fn parameters(request: &SolveTask) -> Map<String, Value> {
    let solve = &request.request;
    let mut members = solve.options().parameters();
    for (name, value) in [
        ("steps", json!(solve.steps())),
        ("attachment", json!(solve.attachment)),
        ("plan", json!(solve.plan)),
        ("leave_out_below_mm", json!(solve.leave_out_below_mm())),
        ("osteotomy", json!(request.osteotomy_id)),
        ("cuts", json!(request.cuts)),
        ("reference_job", json!(solve.reference_job)),
        ("warm_start", json!(request.warm_start.as_ref().map(|before| before.job))),
    ] {
        members.insert(name.to_owned(), value);
    }
    members
}

/// Warnings of the steps that are not in `reported`.
pub(super) fn step_warnings(steps: &[StepDocument], reported: &[WarningDocument]) -> Vec<WarningDocument> {
    let of = |s: &StepDocument| {
        let new = s.findings.iter().filter(|w| !reported.contains(w));
        new.map(|w| step_warning(s.k, w)).collect::<Vec<_>>()
    };
    steps.iter().flat_map(of).collect()
}

/// Documents of stored steps.
pub(super) fn step_documents(steps: &[StepRecord]) -> Result<Vec<StepDocument>, Fault> {
    steps.iter().map(|s| read(&s.document)).collect()
}

/// Times of the jobs that made the parts, and this job's time for the steps.
fn phases(i: &Ingredients<'_>) -> PhasesDocument {
    let wall_s = |kind| i.parts.get(kind).map_or(0.0, |p| p.wall_s);
    let surfaces_s = [PartKind::Skin, PartKind::Skull, PartKind::Air].map(wall_s).iter().sum();
    let (field_s, cut_s, mesh_s) = (wall_s(PartKind::Field), i.request.cut_s, i.mesh_s);
    let (plan_s, solve_s) = (i.request.plan.wall_s, i.solve_s);
    let total_s = surfaces_s + field_s + cut_s + mesh_s + plan_s + solve_s;
    PhasesDocument { surfaces_s, field_s, cut_s, mesh_s, plan_s, solve_s, total_s }
}

/// Inputs of the session with their hashes.
pub(super) fn inputs(parts: &SessionParts) -> Result<BTreeMap<String, ReportInput>, Fault> {
    let mut inputs = BTreeMap::new();
    for part in parts.all() {
        let source_sha256 = match part.kind {
            PartKind::Skin | PartKind::Skull | PartKind::Air | PartKind::Target | PartKind::Bone(_) => {
                Some(read::<SurfaceDocument>(&part.document)?.origin.sha256)
            }
            PartKind::Ct => Some(read::<CtDocument>(&part.document)?.sha256),
            PartKind::Landmarks | PartKind::Frame => None,
            PartKind::Tissue => Some(part.key.clone()),
            // These are derived from the other parts.
            PartKind::SoftTissue | PartKind::FieldSettings | PartKind::Field | PartKind::Mesh => continue,
        };
        inputs.insert(part.kind.as_str().to_owned(), ReportInput { sha256: part.key.clone(), source_sha256 });
    }
    Ok(inputs)
}

pub(super) fn read<T: DeserializeOwned>(text: &str) -> Result<T, Fault> {
    from_json("a document of the job", text)
}
