//! Measurement of mechanical models on one mesh, in a separate process.

use std::path::Path;
use std::str::FromStr;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::error::{BenchError, write};
use super::files::write_distances;
use super::head::{Head, HeadSource, Prepared};
use super::process;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh, Vector};
use prosopon_planning::plan::Plan;
use prosopon_planning::simulate::{CutBone, Frame, RunSettings, SimulateError, solve};
use prosopon_tissue::fem::{Locking, Model, PhaseTimes, Preset, SolveSettings};

/// Streamed steps of the path, as in `prosopon demo`.
pub(super) const STEPS: usize = 6;

/// A mechanical model, a locking treatment and a mesh size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelCase {
    /// Mechanical model, with the skin element that the service uses for it.
    pub(super) model: Model,
    /// Treatment of volumetric locking.
    pub(super) locking: Locking,
    /// Edge of the mesh, mm.
    pub(super) edge_mm: f64,
}

const MODELS: [(&str, Model); 4] = [
    ("linear", Model::Linear),
    ("mass_tensor", Model::MassTensor),
    ("nonlinear", Model::Nonlinear),
    ("mixed", Model::Mixed),
];
const LOCKINGS: [(&str, Locking); 3] =
    [("none", Locking::None), ("smoothed", Locking::Smoothed), ("patched", Locking::Patched)];

impl FromStr for ModelCase {
    type Err = String;

    /// Parses `model:locking:edge`, for example `mixed:smoothed:4`.
    fn from_str(word: &str) -> Result<Self, Self::Err> {
        let fault = || format!("{word:?} is not a case: expected model:locking:edge, for example mixed:smoothed:4");
        let [model, locking, edge] = <[&str; 3]>::try_from(word.split(':').collect::<Vec<_>>()).map_err(|_| fault())?;
        Ok(Self {
            model: MODELS.iter().find(|m| m.0 == model).ok_or_else(fault)?.1,
            locking: locking_of(locking).ok_or_else(fault)?,
            edge_mm: edge.parse().map_err(|_| fault())?,
        })
    }
}

/// Name of a model.
pub(super) fn model_name(model: Model) -> &'static str {
    MODELS.iter().find(|m| m.1 == model).map_or("", |m| m.0)
}

/// Name of a locking treatment.
pub(super) fn locking_name(locking: Locking) -> &'static str {
    LOCKINGS.iter().find(|l| l.1 == locking).map_or("", |l| l.0)
}

/// The locking treatment of a name.
pub(super) fn locking_of(name: &str) -> Option<Locking> {
    LOCKINGS.iter().find(|l| l.0 == name).map(|l| l.1)
}

impl ModelCase {
    pub(super) fn word(&self) -> String {
        format!("{}:{}:{}", model_name(self.model), locking_name(self.locking), self.edge_mm)
    }

    /// The service's settings for the model.
    pub(super) fn settings(&self) -> SolveSettings {
        let settings = SolveSettings::new(self.model, Preset::Wang2009Stable.materials());
        SolveSettings { locking: self.locking, ..settings }
    }
}

/// Time, memory and result of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ModelTiming {
    pub(super) tetrahedra: usize,
    pub(super) prisms: usize,
    pub(super) unknowns: usize,
    /// Outcome of the last step.
    pub(super) outcome: String,
    pub(super) newton_iterations: usize,
    pub(super) factorisations: usize,
    pub(super) max_penetration_mm: f64,
    /// Farthest movement of bone, mm.
    pub(super) displacement_mm: f64,
    /// Farthest movement beside tissue that was left out, mm.
    pub(super) border_mm: f64,
    /// Time for fields, cut and mesh, s.
    pub(super) prepare_s: f64,
    /// Time of the path, from the mesh to the last skin, s.
    pub(super) solve_s: f64,
    /// Processor time of the path on all threads, s.
    pub(super) cpu_s: Option<f64>,
    pub(super) first_frame_s: f64,
    /// Solver time in setup, tangent, factor, solve, residual, contact and line search, s.
    pub(super) phases_s: [f64; 7],
    /// Peak memory during the solve, including fields and mesh, MB.
    pub(super) peak_mb: Option<f64>,
}

/// Names of [`ModelTiming::phases_s`].
pub(super) const PHASES: [&str; 7] =
    ["setup_s", "tangent_s", "factor_s", "triangular_s", "residual_s", "contact_s", "line_search_s"];

/// The phases in the order of [`PHASES`].
pub(super) fn phases_s(p: &PhaseTimes) -> [f64; 7] {
    [p.setup_s, p.tangent_s, p.factor_s, p.solve_s, p.residual_s, p.contact_s, p.line_search_s]
}

/// Seconds since the first call.
pub(super) fn clock() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Result of a case: the measurement, or the reason why the solver refused it.
pub(super) type Measured = Result<ModelTiming, String>;

/// Solves cases on one mesh, in order, and writes their times, memory and outcomes to `timing` as JSON.
///
/// For each solved case, the displacements of all skin vertices are written to `out` with the number of the case (from 0) as
/// extension: three f64 per vertex, mm, NaN where a vertex lies on no prism.
///
/// # Errors
/// [`BenchError`] when the cases name different meshes or the scene cannot be built; a refusal by the solver is a result.
pub fn run_model_cases(source: &HeadSource, cases: &[ModelCase], out: &Path, timing: &Path) -> Result<(), BenchError> {
    let head = Head::load(source)?;
    let edge_mm = cases.first().map_or(f64::NAN, |c| c.edge_mm);
    if cases.iter().any(|c| c.edge_mm != edge_mm) {
        return Err(BenchError::Head { detail: "the cases have several edge lengths: give one".to_owned() });
    }
    let start = Instant::now();
    let ready = head.prepare(edge_mm)?;
    let prepare_s = start.elapsed().as_secs_f64();
    let mut all: Vec<Measured> = Vec::new();
    for (n, case) in cases.iter().enumerate() {
        let measured = match solved(&head, &ready, case, 0.0) {
            Ok((found, moved)) => {
                write_distances(&out.with_extension(n.to_string()), &moved)?;
                Ok(ModelTiming { prepare_s, ..found })
            }
            Err(BenchError::Scene(SimulateError::Solve(error))) => Err(error.to_string()),
            Err(other) => return Err(other),
        };
        all.push(measured);
    }
    write(timing, &serde_json::to_vec(&all).map_err(std::io::Error::other)?)
}

/// Solves a case; returns its measurement and the displacements of the skin as in [`run_model_cases`].
pub(super) fn solved(
    head: &Head,
    ready: &Prepared,
    case: &ModelCase,
    leave_out_below_mm: f64,
) -> Result<(ModelTiming, Vec<f64>), BenchError> {
    process::forget_peak();
    let (start, cpu) = (Instant::now(), process::cpu_s());
    let settings = RunSettings { solver: case.settings(), steps: STEPS, attachment: None, leave_out_below_mm };
    let (mut last, mut first_frame_s) = (None, 0.0);
    let mut on_frame = |frame: Frame| {
        if frame.k == 1 {
            first_frame_s = start.elapsed().as_secs_f64();
        }
        last = Some(frame);
    };
    let control = Control::new().with_clock(clock);
    let outcome = solve(&head.anatomy, &ready.tissue, &ready.bone, &ready.plan, &settings, &control, &mut on_frame)?;
    let solve_s = start.elapsed().as_secs_f64();
    let cpu_s = process::cpu_s().zip(cpu).map(|(after, before)| after - before);
    let peak_mb = process::peak_mb();
    let last = last.ok_or_else(|| BenchError::Head { detail: "the solver returned no step".to_owned() })?;
    let mut phases = PhaseTimes::default();
    outcome.steps.iter().for_each(|s| phases += s.phases);
    let found = ModelTiming {
        tetrahedra: ready.tissue.report.tetrahedra,
        prisms: ready.tissue.report.prisms,
        unknowns: last.report.unknowns,
        outcome: last.report.outcome.name().to_owned(),
        newton_iterations: outcome.steps.iter().map(|s| s.newton_iterations).sum(),
        factorisations: outcome.steps.iter().map(|s| s.factorisations).sum(),
        max_penetration_mm: last.report.max_penetration_mm,
        displacement_mm: largest_displacement_mm(&ready.bone, &ready.plan),
        border_mm: outcome.left_out.border_mm,
        prepare_s: 0.0,
        solve_s,
        cpu_s,
        first_frame_s,
        phases_s: phases_s(&phases),
        peak_mb,
    };
    Ok((found, displacements(head, ready, &last.skin)))
}

/// The farthest that bone moves at the end of the plan, mm.
pub(super) fn largest_displacement_mm(bone: &CutBone, plan: &Plan) -> f64 {
    let of = |(id, motion): &(u32, Motion)| {
        let segments = bone.osteotomy.segments.iter().filter(|s| s.id == *id);
        let points = segments.flat_map(|s| s.surface.positions());
        points.map(|p| (motion * p - p).norm()).fold(0.0, f64::max)
    };
    plan.motions(1.0).iter().map(of).fold(0.0, f64::max)
}

/// Displacements of all skin vertices, as in [`run_model_cases`].
pub(super) fn displacements(head: &Head, ready: &Prepared, skin: &TriMesh) -> Vec<f64> {
    let vertices = head.anatomy.skin.positions().iter().zip(skin.positions()).zip(&ready.tissue.embedding.anchors);
    let moved = vertices.flat_map(|((rest, now), anchor)| {
        let u: Vector = if anchor.is_some() { now - rest } else { Vector::repeat(f64::NAN) };
        <[f64; 3]>::from(u)
    });
    moved.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_read_as_they_are_written() {
        for word in ["linear:none:6", "mixed:smoothed:2.8"] {
            assert_eq!(word.parse::<ModelCase>().unwrap().word(), word);
        }
        for word in ["mixed", "mixed:none:x", "best:none:4", "mixed:some:4"] {
            assert!(word.parse::<ModelCase>().unwrap_err().contains("is not a case"));
        }
    }
}
