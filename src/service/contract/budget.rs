use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::check::Check;
use super::material::LockingName;
use super::model_name::ModelName;
use prosopon_planning::simulate::budget::{Choice, Grounds, Setting};

/// Limits of the asked error, mm.
const ERRORS_MM: [f64; 2] = [0.001, 10.0];

/// Limits within which `auto` chooses mesh and elements; at least one of them.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Largest acceptable numerical error, mm, 0.001 to 10.
    ///
    /// It is the 95th percentile, over the part of the face that moves, of the distance to the converged solution of the same
    /// model. How far a patient's face will be from it is another question.
    #[serde(default)]
    pub max_error_mm: Option<f64>,
    /// Longest acceptable time of mesh and path, s, at least 1; the job's `max_wall_s` counts too, and `within_s` is the shorter.
    ///
    /// It does not stop the job, and the estimate of the error comes on top of it. When a further job goes on, the time of the
    /// jobs before counts too.
    #[serde(default)]
    pub max_wall_s: Option<f64>,
    /// Whether a further job with a better setting follows when time is left and the estimated error misses the budget, or the
    /// budget has no error; true when absent.
    ///
    /// The first job then ends as `succeeded` with `continued_by`, the id of the further one.
    #[serde(default = "yes")]
    pub go_on: bool,
}

fn yes() -> bool {
    true
}

impl Budget {
    pub(super) fn check(&self, most_wall_s: f64, check: &mut Check) {
        if let Some(error_mm) = self.max_error_mm {
            check.number("/budget/max_error_mm", error_mm, ERRORS_MM[0], ERRORS_MM[1]);
        }
        if let Some(wall_s) = self.max_wall_s {
            check.number("/budget/max_wall_s", wall_s, 1.0, most_wall_s);
        }
        if self.max_error_mm.is_none() && self.max_wall_s.is_none() {
            check.fault("/budget", "names no limit: give `max_error_mm`, `max_wall_s` or both");
        }
    }
}

/// Expected error and time of a setting, from the table of `prosopon bench budget`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ExpectedDocument {
    /// Expected numerical error, mm.
    pub error_mm: f64,
    /// Error that 95 % of the table's scenes did not exceed, mm.
    pub error_at_most_mm: f64,
    /// Expected time of mesh and path on this machine, s.
    pub wall_s: f64,
    /// Time that 95 % of the table's scenes did not exceed, s.
    pub wall_at_most_s: f64,
}

/// A setting that was not chosen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AlternativeDocument {
    /// Edge length of the mesh, mm.
    pub edge_mm: f64,
    /// Locking-free formulation.
    pub locking: LockingName,
    /// What it would cost.
    pub expected: ExpectedDocument,
}

/// The setting that was solved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChosenDocument {
    /// Model.
    pub model: ModelName,
    /// Number of steps.
    pub steps: u32,
    /// Edge length of the mesh, mm.
    pub edge_mm: f64,
    /// Locking-free formulation.
    pub locking: LockingName,
}

/// Numerical error, estimated by another solve on a coarser mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EstimateDocument {
    /// Estimated numerical error, mm, defined as `max_error_mm`.
    pub error_mm: f64,
    /// 95th percentile of the distance between the two solutions over the part of the face that moves, mm.
    pub distance_mm: f64,
    /// Edge length of the coarser mesh, mm.
    pub edge_mm: f64,
    /// Time of the coarser mesh and its solve, s.
    pub wall_s: f64,
}

/// A job that missed the budget, and that this one continues.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TriedDocument {
    /// Its id.
    pub job: Uuid,
    /// What it solved.
    pub chosen: ChosenDocument,
    /// What that was expected to cost.
    pub expected: ExpectedDocument,
    /// Its estimated error.
    pub estimated: EstimateDocument,
    /// Time of its mesh and path, s.
    pub spent_s: f64,
}

/// What `auto` chose for a budget and, in the report, whether it was kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BudgetDocument {
    /// The request's limits.
    pub asked: Budget,
    /// What was solved.
    pub chosen: ChosenDocument,
    /// What it was expected to cost.
    pub expected: ExpectedDocument,
    /// Error estimated from the solution; absent where it could not be, which a warning explains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimated: Option<EstimateDocument>,
    /// Time that mesh and path took, s, without error maps and the estimate; absent before the job has ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spent_s: Option<f64>,
    /// Jobs that missed the budget before this one, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<TriedDocument>,
    /// The further job that follows because this one missed the error and time is left.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub continued_by: Option<Uuid>,
    /// Time within which mesh and path were to end, s; absent where nothing limits it.
    ///
    /// It is the shorter of the `max_wall_s` of budget and job, less what earlier jobs took.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_s: Option<f64>,
    /// Reason for the choice.
    pub why: String,
    /// Settings that are faster or more accurate, in order of time.
    pub alternatives: Vec<AlternativeDocument>,
}

fn rounded(value: f64, digits: f64) -> f64 {
    (value * digits).round() / digits
}

impl From<&Setting> for ExpectedDocument {
    fn from(s: &Setting) -> Self {
        Self {
            error_mm: rounded(s.error_mm, 1000.0),
            error_at_most_mm: rounded(s.error_at_most_mm, 1000.0),
            wall_s: rounded(s.wall_s, 10.0),
            wall_at_most_s: rounded(s.wall_at_most_s, 10.0),
        }
    }
}

impl From<&Setting> for AlternativeDocument {
    fn from(s: &Setting) -> Self {
        Self { edge_mm: s.edge_mm, locking: s.locking.into(), expected: s.into() }
    }
}

impl BudgetDocument {
    /// The document of a choice, before the solve.
    #[must_use]
    pub fn new(asked: Budget, within_s: Option<f64>, choice: &Choice, model: ModelName, steps: u32) -> Self {
        let Setting { edge_mm, locking, .. } = choice.chosen;
        let why = match choice.grounds {
            Grounds::Fastest => "the fastest setting that is expected to keep the budget in 95 % of scenes",
            Grounds::MostAccurateInTime => {
                "the most accurate setting that is expected to end in time in 95 % of scenes"
            }
            // Without a limit of time the choice would be more accurate.
            Grounds::ErrorOutOfReach if choice.alternatives.iter().any(|a| a.error_mm < choice.chosen.error_mm) => {
                "no setting that ends in time is expected to be this accurate in 95 % of scenes; this is the most accurate one"
            }
            Grounds::ErrorOutOfReach => {
                "no setting that the request allows is expected to be this accurate in 95 % of scenes; this is the most accurate one"
            }
            Grounds::TimeOutOfReach => {
                "no setting is expected to end in time in 95 % of scenes; this is the fastest one"
            }
        };
        Self {
            asked,
            chosen: ChosenDocument { model, steps, edge_mm, locking: locking.into() },
            expected: (&choice.chosen).into(),
            estimated: None,
            spent_s: None,
            tried: Vec::new(),
            continued_by: None,
            within_s: within_s.map(|s| rounded(s, 10.0)),
            why: why.to_owned(),
            alternatives: choice.alternatives.iter().map(Into::into).collect(),
        }
    }

    /// Time of the jobs before this one with their estimates, s.
    #[must_use]
    pub fn tried_s(&self) -> f64 {
        self.tried.iter().map(|t| t.spent_s + t.estimated.wall_s).sum()
    }

    /// Why the budget was not kept, or was not known to be; `None` when it was.
    #[must_use]
    pub fn missed(&self) -> Option<String> {
        let mut missed = Vec::new();
        if let (Some(asked), Some(found)) = (self.asked.max_error_mm, self.estimated)
            && found.error_mm > asked
        {
            missed.push(format!("the estimated error is {:.3} mm, asked was {asked} mm", found.error_mm));
        }
        if let (Some(asked), Some(spent)) = (self.asked.max_wall_s, self.spent_s) {
            let before = self.tried_s();
            let earlier = if before > 0.0 { format!(" after {before:.2} s of earlier jobs") } else { String::new() };
            if before + spent > asked {
                missed.push(format!("mesh and path took {spent:.2} s{earlier}, asked were {asked} s"));
            }
        }
        (!missed.is_empty()).then(|| missed.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_planning::simulate::budget::{Demand, Limits, choose};

    fn document(max_error_mm: Option<f64>, max_wall_s: Option<f64>) -> BudgetDocument {
        let demand =
            Demand { displacement_mm: 6.0, steps: 6, mesh: None, max_edge_mm: 20.0, edge_mm: None, locking: None };
        let choice = choose(&demand, Limits { error_mm: max_error_mm, wall_s: max_wall_s }).unwrap();
        let asked = Budget { max_error_mm, max_wall_s, go_on: true };
        BudgetDocument::new(asked, max_wall_s, &choice, ModelName::Nonlinear, 6)
    }

    #[test]
    fn what_was_missed_is_said_with_numbers() {
        let mut budget = document(Some(0.2), Some(20.0));
        assert_eq!(budget.missed(), None);
        budget.spent_s = Some(20.04);
        let estimated = EstimateDocument { error_mm: 0.204, distance_mm: 0.2, edge_mm: 5.0, wall_s: 9.0 };
        budget.estimated = Some(estimated);
        let missed = budget.missed().unwrap();
        assert_eq!(
            missed,
            "the estimated error is 0.204 mm, asked was 0.2 mm; mesh and path took 20.04 s, asked were 20 s"
        );
        budget.spent_s = Some(19.9);
        budget.estimated = Some(EstimateDocument { error_mm: 0.2, ..estimated });
        assert_eq!(budget.missed(), None);
    }

    #[test]
    fn reasons_name_the_limit_that_cannot_be_kept() {
        assert!(document(Some(10.0), None).why.starts_with("the fastest setting that is expected to keep"));
        assert!(document(None, Some(1e4)).why.starts_with("the most accurate setting that is expected to end"));
        for wall_s in [None, Some(1e9)] {
            assert!(document(Some(1e-3), wall_s).why.starts_with("no setting that the request allows"));
        }
        assert!(document(Some(1e-3), Some(200.0)).why.starts_with("no setting that ends in time"));
        assert!(document(Some(1.0), Some(1e-3)).why.starts_with("no setting is expected to end in time"));
    }
}
