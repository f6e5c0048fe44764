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

/// Largest number of streamed steps of one job.
pub(super) const MAX_STEPS: u32 = 200;
const DEFAULT_STEPS: u32 = 6;

/// Mechanical model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelName {
    /// The service chooses the model; this version always chooses `mixed`.
    #[default]
    Auto,
    /// Linear finite elements: small strain on linear elements (LFEM).
    Linear,
    /// Mass-tensor model (MTM): small strain; each vertex relaxes under the forces of its neighbours.
    MassTensor,
    /// Nonlinear finite elements: hyperelastic laws on linear elements (NFEM).
    Nonlinear,
    /// Mixed elements: hyperelastic laws with a C1-continuous skin layer (NFM-EM).
    Mixed,
}

/// An optional result of a solve. The service always keeps the skin of each step and the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OutputName {
    /// Deformed skin of each step; kept in any case.
    Skin,
    /// Signed error map of each step, if the session has a target or the job names a reference job.
    Error,
    /// Deformed tissue volume, as VTU.
    Tissue,
}

/// Limits within which `auto` chooses the model. Not available in this version.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Largest acceptable error, mm.
    #[serde(default)]
    pub max_error_mm: Option<f64>,
    /// Longest acceptable computing time, s.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
}

/// Attachment of tissue nodes to bone: tied, sliding or free.
///
/// Absent members follow the default rule: nodes at bone are tied; they slide on the teeth of moving jaws and where periosteum is
/// stripped; they are free beside saw lines. The report's `attached` counts the nodes of each class.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AttachmentRequest {
    /// Boundary nodes closer to bone than this distance are tied, mm, 0 to 50.
    ///
    /// Chosen by the default rule when absent.
    #[serde(default)]
    pub tie_gap_mm: Option<f64>,
    /// Boxes in which nodes slide instead of being tied, LPS mm.
    ///
    /// They replace the default boxes around the teeth.
    #[serde(default)]
    pub sliding: Option<Vec<BoxDocument>>,
    /// At most 1000 boxes and balls that override the rule for the nodes inside.
    ///
    /// Where several contain a node, the last one applies.
    #[serde(default)]
    pub paint: Vec<PaintDocument>,
    /// One class or `null` per skull vertex, in the vertex order of `GET …/skull`.
    ///
    /// A node takes the class of the nearest skull vertex within 5 mm. `paint` overrides it.
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

/// Request for a solve: a plan, a model, and options that all have defaults.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateJob {
    /// Id of the plan that the bone follows.
    pub plan: Uuid,
    /// Mechanical model; `auto` when absent.
    #[serde(default)]
    pub model: ModelName,
    /// Number of streamed steps, 1 to 200.
    ///
    /// When absent: 1 with `warm_start`, else the session's setting, else 6.
    #[serde(default)]
    pub steps: Option<u32>,
    /// Id of a `mesh` job of this session, built for the plan's osteotomy or for no osteotomy.
    ///
    /// The solve uses its mesh.
    ///
    /// When absent, the solve uses the newest mesh that matches the plan's osteotomy. If none matches, the job builds one with
    /// the settings of the newest mesh, or with the defaults if the session has no mesh.
    #[serde(default)]
    pub mesh: Option<Uuid>,
    /// Id of a succeeded solve of this session from whose end state this solve starts.
    ///
    /// Both must have the same mesh, cuts, moving segments, model and settings.
    /// The bone moves straight from the end of that solve's plan to the end of this plan, which takes a fraction of the time.
    /// The steps lie on that path. Where tissue slides over edges of bone, the result can depend slightly on the starting
    /// state: solve plans that you keep from rest. The job starts from rest when absent.
    #[serde(default)]
    pub warm_start: Option<Uuid>,
    /// Limits for the model `auto`. Not available in this version.
    #[serde(default)]
    pub budget: Option<Budget>,
    /// Results to keep besides the report; `skin` and `error` when absent.
    #[serde(default)]
    pub outputs: Option<Vec<OutputName>>,
    /// Id of a succeeded solve as reference of the error maps, if the session has no target.
    ///
    /// Its cuts and paths must be the same.
    #[serde(default)]
    pub reference_job: Option<Uuid>,
    /// Material preset; the session's setting when absent, else `wang_2009_stable`.
    #[serde(default)]
    pub preset: Option<PresetName>,
    /// Meaning of the constant D1 in the preset `wang_2009`; not allowed with other presets.
    ///
    /// `poisson_ratio` when absent.
    #[serde(default)]
    pub d1_reading: Option<D1ReadingName>,
    /// Material laws by tissue that replace those of the preset; the preset's when absent.
    #[serde(default)]
    pub materials: TissueLawsDocument,
    /// Element of the skin layer.
    ///
    /// When absent: `wedge` for `linear` and `mass_tensor`, `tet` for `nonlinear`, `c1_prism` for `mixed`.
    #[serde(default)]
    pub skin_element: Option<SkinElementName>,
    /// Locking-free formulation for nearly incompressible tissue.
    ///
    /// When absent: `smoothed` on an uploaded tissue mesh, else `none`.
    #[serde(default)]
    pub locking: Option<LockingName>,
    /// Convergence tolerance: residual force divided by reaction force, 1e-12 to 0.1; 1e-4 when absent.
    #[serde(default)]
    pub relative_residual: Option<f64>,
    /// Largest penetration of tissue into bone in a converged step, mm, 1e-6 to 10; 0.05 when absent.
    #[serde(default)]
    pub penetration_tolerance_mm: Option<f64>,
    /// Estimated displacement below which tissue is left out, mm, 0 to 1; 0.03 when absent.
    ///
    /// Tissue that is left out is not in the equations and keeps its rest position. 0 keeps all tissue. The report's `left_out`
    /// gives the extent and the effect. Solves on an uploaded tissue mesh always keep all tissue.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 1)]
    pub leave_out_below_mm: Option<f64>,
    /// What to do where a material loses ellipticity; `report` when absent.
    ///
    /// `report` states the loss in the step's `outcome`; the job fails with the problem `solver-unstable` where it finds no
    /// equilibrium. `stabilise` continues there with a neo-Hookean law of the same small-strain moduli.
    #[serde(default)]
    pub unstable_material: UnstableMaterialName,
    /// Attachment of tissue to bone; the default rule, placed by the landmarks, when absent.
    #[serde(default)]
    pub attachment: Option<AttachmentRequest>,
    /// Longest computing time, s, at least 1; the service's limit when absent.
    ///
    /// After that time the job fails and keeps its finished steps.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
    /// Whether this job replaces waiting jobs on the same plan, which are cancelled; false when absent.
    #[serde(default)]
    pub supersede: bool,
}

/// A checked solve request, before the session's inputs are added.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::http) struct CheckedJob {
    pub(in crate::http) physics: PhysicsRecord,
    pub(in crate::http) steps: u32,
    pub(in crate::http) attachment: Option<AttachmentRecord>,
    pub(in crate::http) error_maps: bool,
    pub(in crate::http) tissue: bool,
}

impl CreateJob {
    /// Refuses options that do not apply to an uploaded tissue mesh.
    ///
    /// The mesh has its own attachment, and there is no reference to compare it with.
    pub(in crate::http) fn check_scene(&self) -> Result<(), Fault> {
        let mut check = Check::default();
        if self.attachment.is_some() {
            check.fault("/attachment", "the uploaded tissue mesh has its own array `attachment`; remove this member");
        }
        if self.mesh.is_some() {
            check.fault("/mesh", "solves of this session use the uploaded tissue mesh; remove this member");
        }
        if self.reference_job.is_some() {
            check.fault("/reference_job", "solves on an uploaded tissue mesh make no error maps; remove this member");
        }
        if self.warm_start.is_some() {
            check.fault("/warm_start", "solves on an uploaded tissue mesh start from rest; remove this member");
        }
        if self.leave_out_below_mm.is_some_and(|least| least != 0.0) {
            check.fault("/leave_out_below_mm", "must be 0: solves on an uploaded tissue mesh keep all tissue");
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
            check.fault("/d1_reading", "applies to the preset wang_2009 only; remove it or choose that preset");
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

/// A job and its current state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobView {
    /// Id of the job.
    pub id: Uuid,
    /// Id of the session that the job belongs to.
    pub session: Uuid,
    /// Kind of job: `import`, `field`, `mesh`, `solve` or `compare`.
    pub kind: String,
    /// Status: `accepted`, `running`, `succeeded`, `failed`, `cancelled` or `interrupted`.
    ///
    /// `interrupted` means that the service stopped while the job ran. The job runs again, or fails with the problem
    /// `job-interrupted` when its attempts are used up.
    pub status: String,
    /// Phase of the work.
    ///
    /// One of `waiting`, `reading`, `surfaces`, `field`, `cut`, `mesh`, `solve`, `compare`, `writing` and `done`. A failed or
    /// cancelled job keeps the phase in which it ended.
    pub phase: String,
    /// Completed share of the work, 0 to 1.
    pub progress: f64,
    /// Number of finished steps.
    pub step: u32,
    /// Total number of steps; 0 for a job without steps.
    pub steps: u32,
    /// Estimated remaining time, s; `null` unless the job runs.
    pub eta_s: Option<f64>,
    /// Number of jobs ahead in the queue; `null` unless the job waits.
    pub queue_position: Option<u32>,
    /// How often the job was started.
    pub attempt: u32,
    /// When cancellation was requested (RFC 3339).
    ///
    /// From then on the job ends as `cancelled`, even if the service is killed before it stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cancel_requested_at: Option<String>,
    /// Id of the newer job that replaced this one in the queue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superseded_by: Option<Uuid>,
    /// Residual force of each finished step, in step order, relative to the reaction force.
    pub residuals: Vec<f64>,
    /// Warnings about the inputs and the result.
    pub warnings: Vec<String>,
    /// Problem that made the job fail; `null` unless it failed.
    pub problem: Option<ProblemDocument>,
    /// When the job was accepted (RFC 3339).
    pub created_at: String,
    /// When the last attempt started (RFC 3339).
    pub started_at: Option<String>,
    /// When the job ended (RFC 3339).
    pub finished_at: Option<String>,
    /// Paths by name: `self`, `events`, `cancel` until the job ends, and the results so far.
    pub links: BTreeMap<String, String>,
}

impl JobView {
    /// The view of a stored record, without queue position and steps.
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
    /// The jobs of this page.
    pub jobs: Vec<JobView>,
    /// Path of the next page; absent on the last page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}
