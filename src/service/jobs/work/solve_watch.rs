use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::compare::Reference;
use crate::SkinFrame;
use crate::running::{Phase, Running};
use crate::tasks::{BoneBelow, Mapped, baselines, follow_bone};
use prosopon_contract::{BaselinesDocument, ErrorDocument, Halt, StepDocument, WarningDocument};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Warning};
use prosopon_planning::evaluate::FaceRegion;
use prosopon_planning::simulate::{Frame, PathCheckpoint};
use prosopon_session::{Engine, Run, RunWatch, StoredCheckpoint};
use prosopon_tissue::mesh::MeshReport;

/// Shortest time between two checkpoints.
///
/// When a worker dies, its job loses at most this time and the current step. A checkpoint of a head has 1 to 2 MB.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(2);

/// A solved step on its way from the pool to the store.
#[derive(Debug)]
pub(super) struct FinishedStep {
    pub(super) document: StepDocument,
    pub(super) error: Option<ErrorDocument>,
    pub(super) frame: Vec<u8>,
    /// Checkpoint from which another worker can continue.
    pub(super) checkpoint: Option<Vec<u8>>,
}

/// Start of a solve.
#[derive(Debug)]
pub(super) struct Beginning {
    /// Checkpoint of an earlier attempt; `None` starts from rest.
    pub(super) before: Option<StoredCheckpoint>,
    /// Key of the target and the landmarks that error maps depend on.
    pub(super) compared: String,
}

/// Compares and encodes each frame on the pool and sends it to the writer.
///
/// Waits while the writer is behind.
pub(super) struct SolveWatch<'a> {
    pub(super) engine: &'a dyn Engine,
    /// Control for cancellation only: a comparison is no progress of the solve.
    pub(super) cancel: Control,
    pub(super) running: Arc<Running>,
    pub(super) steps: mpsc::Sender<FinishedStep>,
    pub(super) reference: Option<Reference>,
    pub(super) regions: Vec<FaceRegion>,
    pub(super) mask: Vec<bool>,
    /// Inputs of the solve; `None` for an uploaded tissue mesh.
    pub(super) run: Option<&'a Run>,
    /// Skin of the last step.
    pub(super) last: Option<TriMesh>,
    pub(super) warnings: Vec<WarningDocument>,
    /// Report of the tissue mesh, and its computing time, s.
    pub(super) mesh: Option<(MeshReport, f64)>,
    /// Number of the checkpoint's step, after which the solve continues; 0 from rest.
    pub(super) after: u32,
    /// Key of the target and the landmarks that error maps depend on.
    pub(super) compared: String,
    /// Begin of the current step.
    pub(super) step_began: Instant,
    /// Time of all steps, without comparisons and writing.
    pub(super) solving: Duration,
    /// Time of the last checkpoint, or of the begin of the job.
    pub(super) checkpoint_made: Instant,
}

impl<'a> SolveWatch<'a> {
    /// A watch of a solve, from rest or from a checkpoint.
    pub(super) fn new(
        engine: &'a dyn Engine,
        cancel: Control,
        running: Arc<Running>,
        steps: mpsc::Sender<FinishedStep>,
        Beginning { before, compared }: Beginning,
    ) -> Self {
        let (after, solving_s, warnings) = match before {
            Some(before) => (before.checkpoint.k as u32, before.solving_s.clamp(0.0, 1e6), before.warnings()),
            None => (0, 0.0, Vec::new()),
        };
        Self {
            engine,
            cancel,
            running,
            steps,
            reference: None,
            regions: Vec::new(),
            mask: Vec::new(),
            run: None,
            last: None,
            warnings,
            mesh: None,
            after,
            compared,
            step_began: Instant::now(),
            solving: Duration::from_secs_f64(solving_s),
            checkpoint_made: Instant::now(),
        }
    }

    /// An encoded checkpoint after the step at path parameter `t`, at intervals; none after the last step.
    fn checkpoint(&mut self, t: f64, checkpoint: &dyn Fn() -> Option<PathCheckpoint>) -> Option<Vec<u8>> {
        if t >= 1.0 || self.checkpoint_made.elapsed() < CHECKPOINT_EVERY {
            return None;
        }
        self.checkpoint_made = Instant::now();
        let so_far = (self.solving.as_secs_f64(), self.warnings.as_slice());
        StoredCheckpoint::new(checkpoint()?, so_far, self.compared.clone()).encode()
    }

    fn compare(&mut self, k: u32, frame: &Frame) -> Option<(ErrorDocument, Vec<f32>)> {
        let (name, reference) = self.reference.as_ref()?.at(k)?;
        let map = self.engine.error_map(&frame.skin, reference, Some(&self.mask), &self.regions, &self.cancel);
        match map {
            Ok(map) => {
                let models = self.reference.as_ref().and_then(Reference::models);
                let mapped = Mapped {
                    prediction: &frame.skin,
                    map: &map,
                    reference,
                    mask: Some(&self.mask),
                    regions: &self.regions,
                };
                let baselines = match self.baselines(frame.t, &mapped) {
                    Ok(baselines) => baselines,
                    // The solver sees the cancellation at its next check.
                    Err(Halt::Cancelled) => None,
                    Err(Halt::Fault(fault)) => {
                        let message = format!("simple predictions could not be compared with {name}: {}", fault.detail);
                        self.warnings.push(Warning::check("step-not-compared", message).into());
                        None
                    }
                };
                let document = ErrorDocument { models, baselines, ..ErrorDocument::new(name, "face", &map) };
                Some((document, map.signed_mm))
            }
            // The solver sees the cancellation at its next check.
            Err(Halt::Cancelled) => None,
            Err(Halt::Fault(fault)) => {
                let message = format!("step {k} could not be compared with {name}: {}", fault.detail);
                self.warnings.push(Warning::check("step-not-compared", message).into());
                None
            }
        }
    }
}

impl SolveWatch<'_> {
    /// Baselines of the last step; `None` for the others, which are for display.
    fn baselines(&self, t: f64, mapped: &Mapped<'_>) -> Result<Option<BaselinesDocument>, Halt> {
        let Some(run) = self.run.filter(|_| t >= 1.0) else { return Ok(None) };
        let rest = self.engine.skin(run, &self.cancel)?;
        let below = BoneBelow { case: run.case.clone(), cuts: run.cuts.clone(), motions: run.plan.motions(t) };
        let bone = follow_bone(self.engine, &below, &rest, &self.cancel)?;
        baselines(mapped, &rest, bone, &self.cancel).map(Some)
    }
}

impl RunWatch for SolveWatch<'_> {
    fn stage(&mut self, name: &'static str) {
        self.running.set_phase(Phase::of_stage(name));
        self.step_began = Instant::now();
    }

    fn mesh(&mut self, report: &MeshReport) {
        self.mesh = Some((report.clone(), self.step_began.elapsed().as_secs_f64()));
    }

    fn warning(&mut self, warning: Warning) {
        self.running.warn(warning.into());
    }

    fn frame(&mut self, frame: Frame, checkpoint: &dyn Fn() -> Option<PathCheckpoint>) {
        let taken = self.step_began.elapsed();
        if frame.k as u32 <= self.after {
            // The checkpoint did not match this job, so the solve started from rest again.
            (self.after, self.solving, self.warnings) = (0, Duration::ZERO, Vec::new());
        }
        self.solving += taken;
        let document = StepDocument::new(&frame, taken.as_secs_f64());
        let compared = self.compare(document.k, &frame);
        let (error, error_mm) = compared.unzip();
        let positions_mm = frame.skin.positions().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        let encoded = SkinFrame { positions_mm, displacement_mm: frame.displacement_mm, error_mm }.encode();
        self.last = Some(frame.skin);
        // Sending fails only after the writer has failed, and then the writer cancels the control.
        let checkpoint = self.checkpoint(document.t, checkpoint);
        self.steps.blocking_send(FinishedStep { document, error, frame: encoded, checkpoint }).ok();
        self.step_began = Instant::now();
    }
}
