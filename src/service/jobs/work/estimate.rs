//! Estimate of the numerical error of a solve by another one on a coarser mesh, for budgets.

use std::time::{Duration, Instant};

use prosopon_contract::{BudgetDocument, EstimateDocument, Halt};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Warning};
use prosopon_planning::simulate::budget::{COARSER, error_from_distance};
use prosopon_session::{Engine, Run, TissueRequest};

/// Time of the coarser mesh and its solve, in units of that of the path: (1 / 1.25)³ and the mesh.
const SHARE: f64 = 0.6;
/// The estimate may take this many times as long as expected.
const PATIENCE: f64 = 3.0;
/// Least time that is allowed when there is no limit, s.
const LEAST_S: f64 = 20.0;
/// Share of the time to the job's deadline that the estimate may use, so that its failure does not end the job.
const OF_DEADLINE: f64 = 0.5;

/// A budget and what its estimate needs.
#[derive(Debug)]
pub(super) struct Estimating {
    pub(super) budget: BudgetDocument,
    /// The chosen mesh with edges [`COARSER`] times as long.
    pub(super) coarser: TissueRequest,
}

impl Estimating {
    /// The budget with the time `spent` on mesh and path and the estimated error; a warning where that is not known.
    ///
    /// `moved` is the skin at the end of the path.
    pub(super) fn finish(
        self,
        engine: &dyn Engine,
        run: &Run,
        moved: Option<&TriMesh>,
        [spent, path]: [Duration; 2],
        control: &Control,
    ) -> Result<(BudgetDocument, Vec<Warning>), Halt> {
        let Self { mut budget, coarser } = self;
        let spent_s = spent.as_secs_f64();
        budget.spent_s = Some(spent_s);
        let expected_s = SHARE * path.as_secs_f64();
        let of_budget = budget.asked.max_wall_s.map_or(LEAST_S.max(PATIENCE * expected_s), |most| most - spent_s);
        let allowed_s = of_budget.min(OF_DEADLINE * control.left_s());
        let begin = Instant::now();
        let found = match moved {
            Some(moved) if allowed_s >= expected_s => {
                engine.distance_to_mesh(run, moved, &coarser, &control.within(allowed_s))
            }
            Some(_) => Err(Halt::Cancelled),
            None => return Ok((budget, Vec::new())),
        };
        let why = match found {
            Ok(distance_mm) => {
                budget.estimated = Some(EstimateDocument {
                    error_mm: error_from_distance(distance_mm, run.settings.solver.locking),
                    distance_mm,
                    edge_mm: coarser.settings.mesh.edge_mm,
                    wall_s: begin.elapsed().as_secs_f64(),
                });
                None
            }
            Err(Halt::Cancelled) => {
                control.check()?;
                Some("no time was left".to_owned())
            }
            Err(Halt::Fault(fault)) => Some(fault.detail),
        };
        let mut warnings = Vec::new();
        if let Some(why) = why {
            let message =
                format!("the numerical error was not estimated on a mesh with {COARSER} times the edge: {why}");
            let action = "Allow more time, or compare with a solve on a finer mesh.";
            warnings.push(Warning::check("error-not-estimated", message).act(action));
        }
        if let Some(missed) = budget.missed() {
            let action = "See `budget.alternatives` for settings that are more accurate or faster.";
            warnings.push(Warning::check("budget-missed", missed).act(action));
        }
        Ok((budget, warnings))
    }
}
