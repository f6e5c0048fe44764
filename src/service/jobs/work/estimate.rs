//! Estimate of the numerical error of a solve by another one on a coarser mesh, for budgets.

use std::time::Instant;

use prosopon_contract::{BudgetDocument, EstimateDocument, Halt};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Warning};
use prosopon_planning::simulate::budget::{COARSER, error_from_distance};
use prosopon_session::{Engine, Run, TissueRequest};

/// Time that the estimate may take: this long for the coarser mesh, s, and this many times that of the path.
const MESH_S: f64 = 60.0;
const PATIENCE: f64 = 3.0;
/// Share of the time to the job's deadline that the estimate may use, so that its failure does not end the job.
const OF_DEADLINE: f64 = 0.5;

/// A budget and what its estimate needs.
#[derive(Debug)]
pub(super) struct Estimating {
    pub(super) budget: BudgetDocument,
    /// The chosen mesh with edges [`COARSER`] times as long.
    pub(super) coarser: TissueRequest,
    /// What of the job the table's scenes did not have.
    pub(super) unlike: Vec<&'static str>,
}

impl Estimating {
    /// The budget with the time of the mesh and of the path, s, and the estimated error; a warning where that is not known.
    ///
    /// `moved` is the skin at the end of the path.
    pub(super) fn finish(
        self,
        engine: &dyn Engine,
        run: &Run,
        moved: Option<&TriMesh>,
        [mesh_s, path_s]: [f64; 2],
        control: &Control,
    ) -> Result<(BudgetDocument, Vec<Warning>), Halt> {
        let Self { mut budget, coarser, unlike } = self;
        budget.spent_s = Some(mesh_s + path_s);
        let Some(moved) = moved else { return Ok((budget, Vec::new())) };
        let allowed_s = (MESH_S + PATIENCE * path_s).min(OF_DEADLINE * control.left_s());
        let begin = Instant::now();
        let control_of_estimate = control.within(allowed_s);
        let mesh = engine.tissue(&run.case, &coarser, &control_of_estimate.stage(0.0, 0.3));
        let found = mesh.and_then(|mesh| {
            let distance = engine.distance_to_mesh(run, moved, &coarser, &control_of_estimate.stage(0.3, 1.0))?;
            Ok((mesh, distance))
        });
        let mut warnings = Vec::new();
        let unknown = match found {
            Ok((mesh, distance_mm)) => {
                let shortened = mesh.warnings.into_iter().filter(|w| w.code == "mesh-edge-shortened");
                warnings.extend(shortened.map(|w| w.about("mesh of the estimate, whose error is then too small")));
                budget.estimated = distance_mm.map(|distance_mm| EstimateDocument {
                    error_mm: error_from_distance(distance_mm, run.settings.solver.locking),
                    distance_mm,
                    edge_mm: coarser.settings.mesh.edge_mm,
                    wall_s: begin.elapsed().as_secs_f64(),
                });
                distance_mm.is_none().then(|| Warning::info("error-not-estimated", "no part of the face moves"))
            }
            Err(Halt::Cancelled) => {
                control.check()?;
                Some(unknown(&format!("it took longer than {allowed_s:.0} s")).act("Raise `max_wall_s` of the job."))
            }
            Err(Halt::Fault(fault)) => {
                Some(unknown(&fault.detail).act("Choose another edge or depth, or compare with a finer mesh."))
            }
        };
        warnings.extend(unknown);
        if !unlike.is_empty() {
            let message = format!("expected and estimated errors come from scenes without such {}", unlike.join(", "));
            let action = "Compare with a solve on a finer mesh.";
            warnings.push(Warning::check("budget-not-studied", message).act(action));
        }
        if let Some(missed) = budget.missed() {
            let action = if budget.alternatives.is_empty() {
                "Leave `mesh` and `locking` out, so that other settings can be chosen, or ask for less."
            } else {
                "See the alternatives of the report's `budget`, which are more accurate or faster."
            };
            warnings.push(Warning::check("budget-missed", missed).act(action));
        }
        Ok((budget, warnings))
    }
}

fn unknown(why: &str) -> Warning {
    let message = format!("the numerical error was not estimated on a mesh with {COARSER} times the edge: {why}");
    Warning::check("error-not-estimated", message)
}
