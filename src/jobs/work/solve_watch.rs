use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::compare::Reference;
use crate::control::Control;
use crate::evaluate::FaceRegion;
use crate::jobs::SkinFrame;
use crate::jobs::running::{Phase, Running};
use crate::session::{Engine, ErrorDocument, Halt, RunWatch, StepDocument};
use crate::simulate::Frame;

/// A step on its way from the pool to the store.
#[derive(Debug)]
pub(super) struct FinishedStep {
    pub(super) document: StepDocument,
    pub(super) error: Option<ErrorDocument>,
    pub(super) frame: Vec<u8>,
}

/// Compares and encodes each frame on the pool and hands it to the writer; waits when the writer is behind.
pub(super) struct SolveWatch<'a> {
    pub(super) engine: &'a dyn Engine,
    /// Tells of cancellation only: comparing is no progress of the path.
    pub(super) cancel: Control,
    pub(super) running: Arc<Running>,
    pub(super) steps: mpsc::Sender<FinishedStep>,
    pub(super) reference: Option<Reference>,
    pub(super) regions: Vec<FaceRegion>,
    pub(super) mask: Vec<bool>,
    pub(super) warnings: Vec<String>,
    /// When the present step began.
    pub(super) step_began: Instant,
    /// Time of all steps, without comparing and writing.
    pub(super) solving: Duration,
}

impl SolveWatch<'_> {
    fn compare(&mut self, k: u32, frame: &Frame) -> Option<(ErrorDocument, Vec<f32>)> {
        let (name, reference) = self.reference.as_ref()?.at(k)?;
        let map = self.engine.error_map(&frame.skin, reference, Some(&self.mask), &self.regions, &self.cancel);
        match map {
            Ok(map) => Some((ErrorDocument::new(name, "face", &map), map.signed_mm)),
            // The solver meets the cancellation at its next check.
            Err(Halt::Cancelled) => None,
            Err(Halt::Fault(fault)) => {
                self.warnings.push(format!("step {k} could not be compared with {name}: {}", fault.detail));
                None
            }
        }
    }
}

impl RunWatch for SolveWatch<'_> {
    fn stage(&mut self, name: &'static str) {
        self.running.set_phase(Phase::of_stage(name));
        self.step_began = Instant::now();
    }

    fn warning(&mut self, text: String) {
        self.running.warn(text);
    }

    fn frame(&mut self, frame: Frame) {
        let taken = self.step_began.elapsed();
        self.solving += taken;
        let document = StepDocument::new(&frame, taken.as_secs_f64());
        let compared = self.compare(document.k, &frame);
        let (error, error_mm) = compared.unzip();
        let positions_mm = frame.skin.positions().iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
        let frame = SkinFrame { positions_mm, displacement_mm: frame.displacement_mm, error_mm }.encode();
        // The writer leaves only when it has failed, and then it cancels the control.
        self.steps.blocking_send(FinishedStep { document, error, frame }).ok();
        self.step_began = Instant::now();
    }
}
