use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::SessionSettings;
use super::check::{Check, REACH_MM};
use super::material::check_laws;
use crate::http::problem::ProblemDocument;
use prosopon_jobs::{AttachmentRecord, JobStatus, PhysicsRecord, SolveModel};
use prosopon_planning::simulate::LEAVE_OUT_BELOW_MM;
use prosopon_session::{
    BoxDocument, D1ReadingName, Fault, FaultKind, LockingName, NodeClassName, PaintDocument, PresetName,
    SkinElementName, TissueLawsDocument, UnstableMaterialName,
};
use prosopon_store::{JobKind, JobRecord, JobState};

/// Steps that a job may have.
pub(super) const MAX_STEPS: u32 = 200;
const DEFAULT_STEPS: u32 = 6;

/// Mechanical model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelName {
    /// The service chooses; `mixed` in this version.
    #[default]
    Auto,
    /// Small strain on linear elements (LFEM).
    Linear,
    /// Small strain again, vertices relaxed under the forces of their neighbours (MTM).
    MassTensor,
    /// Hyperelastic on linear elements (NFEM).
    Nonlinear,
    /// Hyperelastic with a C1 skin layer (NFM-EM).
    Mixed,
}

/// A result to keep besides skin and report, which are always kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutputName {
    /// Deformed skin of each step.
    Skin,
    /// Error maps, where there is something to compare with.
    Error,
    /// The deformed volume.
    Tissue,
}

/// What `auto` has to keep to.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Largest error, mm.
    #[serde(default)]
    pub max_error_mm: Option<f64>,
    /// Longest time, s.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
}

/// Which inner nodes are tied to bone, which slide, which are free. What is absent follows the default rule: nodes at bone are tied, slide on
/// the teeth of the jaws that move and where periosteum is stripped, and are free beside saw lines. The report's `attached` counts them.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AttachmentRequest {
    /// Boundary nodes nearer to bone than this are tied, mm, 0 to 50.
    #[serde(default)]
    pub tie_gap_mm: Option<f64>,
    /// Boxes in which nodes slide instead; they replace those around the teeth.
    #[serde(default)]
    pub sliding: Option<Vec<BoxDocument>>,
    /// Classes painted in boxes and balls, at most 1000, over the rule; the last one that holds a node wins.
    #[serde(default)]
    pub paint: Vec<PaintDocument>,
    /// Classes painted on the skull, one (or null) per vertex as `GET …/skull` gives them: a node takes that of the nearest vertex within
    /// 5 mm. `paint` goes over it.
    #[serde(default)]
    pub skull_classes: Option<Vec<Option<NodeClassName>>>,
}

fn checked_paint(check: &mut Check, paint: &[PaintDocument]) -> Vec<PaintDocument> {
    const MOST: usize = 1000;
    if paint.len() > MOST {
        check.fault("/attachment/paint", format!("has {} parts, at most {MOST} are allowed", paint.len()));
    }
    for (i, p) in paint.iter().take(MOST).enumerate() {
        let pointer = format!("/attachment/paint/{i}");
        for (name, place) in [("min_mm", p.min_mm), ("max_mm", p.max_mm), ("centre_mm", p.centre_mm)] {
            place.map(|v| check.vector(&format!("{pointer}/{name}"), v));
        }
        p.radius_mm.map(|r| check.number(&format!("{pointer}/radius_mm"), r, 0.1, REACH_MM));
        if p.paint().is_none() {
            check.fault(pointer, "must have min_mm below max_mm, or centre_mm and radius_mm");
        }
    }
    paint.to_vec()
}

/// A solve.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateJob {
    /// The plan to follow.
    pub plan: Uuid,
    /// Mechanical model.
    #[serde(default)]
    pub model: ModelName,
    /// Streamed steps, 1 to 200; the session's, else 6. With `warm_start` 1 where absent.
    #[serde(default)]
    pub steps: Option<u32>,
    /// A job that built a mesh for the plan's osteotomy, or for none: its mesh. When absent the one that fits and was built last; where none
    /// fits the job builds it, with the settings of the last one, else with the defaults.
    #[serde(default)]
    pub mesh: Option<Uuid>,
    /// A solve of this session that has succeeded, with the same mesh, cuts, segments, model and settings: bone goes straight from the end of its
    /// plan to the end of this one, which takes a fraction of the time. The steps show that way. Where tissue slides over edges of bone
    /// the result may hang a little on where it came from: plans to be kept are best solved from rest.
    #[serde(default)]
    pub warm_start: Option<Uuid>,
    /// What `auto` has to keep to; not in this version.
    #[serde(default)]
    pub budget: Option<Budget>,
    /// Results to keep; `skin` and `error` when absent.
    #[serde(default)]
    pub outputs: Option<Vec<OutputName>>,
    /// A finished job to compare with, where the session has no target.
    #[serde(default)]
    pub reference_job: Option<Uuid>,
    /// Materials; the session's, else `wang_2009_stable`.
    #[serde(default)]
    pub preset: Option<PresetName>,
    /// Meaning of D1 in the preset `wang_2009`.
    #[serde(default)]
    pub d1_reading: Option<D1ReadingName>,
    /// Laws in place of the preset's.
    #[serde(default)]
    pub materials: TissueLawsDocument,
    /// Element of the skin layer; `wedge` for `linear` and `mass_tensor`, `tet` for `nonlinear`, `c1_prism` for `mixed` when absent.
    #[serde(default)]
    pub skin_element: Option<SkinElementName>,
    /// Cure of locking near incompressibility; when absent `smoothed` on a ready tissue mesh, else `none`.
    #[serde(default)]
    pub locking: Option<LockingName>,
    /// Residual force over reaction force at which a step is in equilibrium; 1e-4 when absent.
    #[serde(default)]
    pub relative_residual: Option<f64>,
    /// Penetration of bone that is left at most, mm; 0.05 when absent.
    #[serde(default)]
    pub penetration_tolerance_mm: Option<f64>,
    /// Tissue that the plan moves by less than this, by estimate, is left out of the equations and stays where it is, mm, 0 to 1; 0.03 when absent, 0
    /// keeps all. The report says under `left_out` what came of it. Sessions with a tissue mesh keep all.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 1)]
    pub leave_out_below_mm: Option<f64>,
    /// What is done where a material loses ellipticity: `report` (the default) says so in the step's `outcome`, and the job fails by name
    /// where no equilibrium is found; `stabilise` goes on with neo-Hookean of the same small-strain moduli.
    #[serde(default)]
    pub unstable_material: UnstableMaterialName,
    /// Attachment; chosen from the landmarks when absent.
    #[serde(default)]
    pub attachment: Option<AttachmentRequest>,
    /// Longest time that it may compute, s, from 1 on; the service's limit when absent. Then it fails, and finished steps stay.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
    /// Whether jobs on the same plan that still wait are cancelled, and this one takes their place.
    #[serde(default)]
    pub supersede: bool,
}

/// A checked solve, without what the session adds.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::http) struct CheckedJob {
    pub(in crate::http) physics: PhysicsRecord,
    pub(in crate::http) steps: u32,
    pub(in crate::http) attachment: Option<AttachmentRecord>,
    pub(in crate::http) error_maps: bool,
    pub(in crate::http) tissue: bool,
}

impl CreateJob {
    /// What a ready mesh cannot have: it brings its own attachment, and there is nothing to compare it with.
    pub(in crate::http) fn check_scene(&self) -> Result<(), Fault> {
        let mut check = Check::default();
        if self.attachment.is_some() {
            check.fault("/attachment", "the session has a tissue mesh, whose array `attachment` says what is tied");
        }
        if self.mesh.is_some() {
            check.fault("/mesh", "the session has a tissue mesh, which jobs take");
        }
        if self.reference_job.is_some() {
            check.fault("/reference_job", "jobs on a tissue mesh make no error maps");
        }
        if self.warm_start.is_some() {
            check.fault("/warm_start", "jobs on a tissue mesh begin at rest");
        }
        if self.leave_out_below_mm.is_some_and(|least| least != 0.0) {
            check.fault("/leave_out_below_mm", "the session has a tissue mesh, of which nothing is left out");
        }
        check.finish()
    }

    pub(in crate::http) fn check(&self, settings: &SessionSettings, max_wall: Duration) -> Result<CheckedJob, Fault> {
        let (model, model_chosen) = match self.model {
            ModelName::Auto => (SolveModel::Mixed, true),
            ModelName::Mixed => (SolveModel::Mixed, false),
            ModelName::Linear => (SolveModel::Linear, false),
            ModelName::MassTensor => (SolveModel::MassTensor, false),
            ModelName::Nonlinear => (SolveModel::Nonlinear, false),
        };
        if self.budget.is_some() {
            return Err(Fault::new(FaultKind::NotAvailable, "budgets are not available in this version").at("/budget"));
        }
        let mut check = Check::default();
        let usual = if self.warm_start.is_some() { 1 } else { settings.steps.unwrap_or(DEFAULT_STEPS) };
        let steps = self.steps.unwrap_or(usual);
        check.number("/steps", f64::from(steps), 1.0, f64::from(MAX_STEPS));
        let attachment = self.attachment.as_ref().map(|a| AttachmentRecord {
            tie_gap_mm: a.tie_gap_mm.map(|gap| check.number("/attachment/tie_gap_mm", gap, 0.0, 50.0)),
            sliding: a.sliding.as_ref().map(|boxes| {
                let boxes = boxes.iter().enumerate();
                boxes.map(|(i, b)| check.bounds(&format!("/attachment/sliding/{i}"), *b)).collect()
            }),
            paint: checked_paint(&mut check, &a.paint),
            skull_classes: a.skull_classes.clone(),
        });
        let preset = self.preset.or(settings.preset).unwrap_or_default();
        if self.d1_reading.is_some() && preset != PresetName::Wang2009 {
            check.fault("/d1_reading", "has a meaning for the preset wang_2009 only");
        }
        check_laws(&mut check, "/materials", &self.materials);
        if let Some(share) = self.relative_residual {
            check.number("/relative_residual", share, 1e-12, 0.1);
        }
        if let Some(depth) = self.penetration_tolerance_mm {
            check.number("/penetration_tolerance_mm", depth, 1e-6, 10.0);
        }
        if let Some(seconds) = self.max_wall_s {
            check.number("/max_wall_s", seconds, 1.0, max_wall.as_secs_f64());
        }
        if let Some(least) = self.leave_out_below_mm {
            check.number("/leave_out_below_mm", least, 0.0, 1.0);
        }
        check.finish()?;
        let physics = PhysicsRecord {
            model,
            model_chosen,
            skin_element: self.skin_element,
            locking: self.locking,
            preset,
            d1_reading: self.d1_reading.unwrap_or_default(),
            materials: self.materials,
            relative_residual: self.relative_residual,
            penetration_tolerance_mm: self.penetration_tolerance_mm,
            unstable_material: self.unstable_material,
            leave_out_below_mm: self.leave_out_below_mm.unwrap_or(LEAVE_OUT_BELOW_MM),
        };
        let wants = |output| self.outputs.as_ref().map(|o| o.contains(&output));
        Ok(CheckedJob {
            physics,
            steps,
            attachment,
            error_maps: wants(OutputName::Error).unwrap_or(true),
            tissue: wants(OutputName::Tissue).unwrap_or(false),
        })
    }
}

/// A job and how it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// Its id.
    pub id: Uuid,
    /// Its session.
    pub session: Uuid,
    /// `import`, `field`, `mesh`, `solve` or `compare`.
    pub kind: String,
    /// `accepted`, `running`, `succeeded`, `failed`, `cancelled` or `interrupted` (the service stopped; it will run again, or fail with
    /// the problem `job-interrupted` when it had its attempts).
    pub status: String,
    /// Stage of the work: `waiting`, `reading`, `surfaces`, `field`, `cut`, `mesh`, `solve`, `compare`, `writing`, `done`; of a job that failed or
    /// was cancelled the one in which it ended.
    pub phase: String,
    /// Done share, 0 to 1.
    pub progress: f64,
    /// Steps that are there.
    pub step: u32,
    /// Steps in all; 0 for a job without steps.
    pub steps: u32,
    /// Time left, s, while it runs.
    pub eta_s: Option<f64>,
    /// Jobs before it, while it waits.
    pub queue_position: Option<u32>,
    /// How often it was started.
    pub attempt: u32,
    /// When it was asked to stop: from then on it ends as `cancelled`, also where the service is killed before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cancel_requested_at: Option<String>,
    /// The newer job that took its place in the queue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superseded_by: Option<Uuid>,
    /// Residual force of each finished step in order, relative to the reaction force.
    pub residuals: Vec<f64>,
    /// What a caller should know.
    pub warnings: Vec<String>,
    /// Why it failed.
    pub problem: Option<ProblemDocument>,
    /// When it was accepted.
    pub created_at: String,
    /// When the last attempt began.
    pub started_at: Option<String>,
    /// When it ended.
    pub finished_at: Option<String>,
    /// Paths: `self`, `events`, `cancel`, and what has come of it.
    pub links: BTreeMap<String, String>,
}

impl JobView {
    /// The view of a row alone.
    pub(in crate::http) fn new(record: &JobRecord) -> Self {
        let fault: Option<Fault> = record.fault.as_deref().and_then(|f| serde_json::from_str(f).ok());
        Self {
            id: record.id.uuid(),
            session: record.session.uuid(),
            kind: record.kind.as_str().to_owned(),
            status: record.state.as_str().to_owned(),
            phase: record.phase.clone(),
            progress: record.progress,
            step: 0,
            steps: record.steps,
            eta_s: None,
            queue_position: None,
            attempt: record.attempt,
            cancel_requested_at: record.cancel_requested_at.clone(),
            superseded_by: record.superseded_by.map(prosopon_store::JobId::uuid),
            residuals: Vec::new(),
            warnings: record.warnings.clone(),
            problem: fault.as_ref().map(ProblemDocument::from),
            created_at: record.created_at.clone(),
            started_at: record.started_at.clone(),
            finished_at: record.finished_at.clone(),
            links: links(record, 0),
        }
    }
}

impl From<&JobStatus> for JobView {
    fn from(status: &JobStatus) -> Self {
        Self {
            step: status.steps_done,
            eta_s: status.eta_s,
            queue_position: status.queue_position,
            residuals: status.residuals.clone(),
            links: links(&status.record, status.steps_done),
            ..Self::new(&status.record)
        }
    }
}

fn links(record: &JobRecord, steps_done: u32) -> BTreeMap<String, String> {
    let own = format!("/v1/jobs/{}", record.id);
    let mut links = BTreeMap::from([("self".to_owned(), own.clone())]);
    let mut add = |name: &str, path: String| links.insert(name.to_owned(), path);
    add("events", format!("{own}/events"));
    if !record.state.has_ended() {
        add("cancel", format!("{own}/cancel"));
    }
    let session = format!("/v1/sessions/{}", record.session);
    match (record.kind, record.state) {
        (JobKind::Import, JobState::Succeeded) => {
            add("skin", format!("{session}/skin"));
            add("skull", format!("{session}/skull"));
        }
        (JobKind::Field, JobState::Succeeded) => _ = add("field", format!("{session}/field")),
        (JobKind::Compare, JobState::Succeeded) if record.rest_blob.is_some() => {
            _ = add("comparison", format!("{own}/comparison"))
        }
        (JobKind::Mesh, JobState::Succeeded) => _ = add("mesh", format!("{session}/mesh")),
        (JobKind::Solve, state) => {
            if steps_done > 0 {
                add("topology", format!("{own}/topology"));
                add("last_skin", format!("{own}/steps/{steps_done}/skin"));
            }
            if state == JobState::Succeeded {
                add("report", format!("{own}/report"));
                if record.tissue_blob.is_some() {
                    add("tissue", format!("{own}/tissue"));
                }
            }
        }
        _ => {}
    }
    links
}

/// A page of jobs, newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobList {
    /// The jobs.
    pub jobs: Vec<JobView>,
    /// Path of the next page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}
