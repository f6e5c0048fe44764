//! Studies that solve many operations on several heads.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::super::CommandResult;
use prosopon_planning::simulate::Mouth;
use prosopon_study::{
    AssumptionStudy, BudgetStudy, HeadSource, ModelCase, OperationStudy, PoseStudy, ProposalStudy, RatioStudy,
};

#[derive(Debug, Args)]
pub(in crate::cli) struct ProposalArguments {
    /// Heads as for `operations`.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
}

#[derive(Debug, Args)]
pub(in crate::cli) struct OperationArguments {
    /// Heads: `phantom`, `phantom-long`, `phantom-narrow`, or folders as for `models`; missing landmarks are proposed.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Models as model:locking:edge, edge length in mm.
    #[arg(long, value_delimiter = ',', default_value = "nonlinear:none:4")]
    cases: Vec<ModelCase>,
    /// Run only operations whose name contains this text.
    #[arg(long)]
    only: Option<String>,
    /// Time limit of a solve, s.
    #[arg(long, default_value_t = 180.0)]
    limit_s: f64,
    /// The lips part, where the crease between them is found.
    #[arg(long)]
    part_lips: bool,
    /// CSV file to write; the chart is written next to it.
    #[arg(long, default_value = "operations.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(in crate::cli) struct AssumptionArguments {
    /// Heads: `phantom`, `phantom-long`, `phantom-narrow`, or folders as for `models`; missing landmarks are proposed.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Names of operations as in `operations` [default: one of each kind].
    #[arg(long, value_delimiter = ';')]
    operations: Vec<String>,
    /// Run only choices whose name contains one of these texts.
    #[arg(long, value_delimiter = ';')]
    only: Vec<String>,
    /// Time limit of a solve, s.
    #[arg(long, default_value_t = 180.0)]
    limit_s: f64,
    /// CSV file to write; the chart is written next to it.
    #[arg(long, default_value = "assumptions.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(in crate::cli) struct BudgetArguments {
    /// Heads as for `operations`.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Names of operations as in `operations` [default: a Le Fort I, a split osteotomy and a genioplasty].
    #[arg(long, value_delimiter = ';')]
    operations: Vec<String>,
    /// Edge lengths of the meshes, mm, from coarse to fine; the first one serves the estimate of the second.
    #[arg(long, value_delimiter = ',', default_value = "8.6,7,5.5,4.5,3.7")]
    edges_mm: Vec<f64>,
    /// Edge length of the reference, mm.
    #[arg(long, default_value_t = 3.0)]
    reference_mm: f64,
    /// Time limit of a solve, s.
    #[arg(long, default_value_t = 600.0)]
    limit_s: f64,
    /// CSV file to write; the chart is written next to it.
    #[arg(long, default_value = "budget.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(in crate::cli) struct RatioArguments {
    /// Heads as for `operations`.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Model as model:locking:edge, edge length in mm.
    #[arg(long, default_value = "nonlinear:none:4")]
    case: ModelCase,
    /// Run only operations whose name contains this text.
    #[arg(long)]
    only: Option<String>,
    /// Time limit of a solve, s.
    #[arg(long, default_value_t = 180.0)]
    limit_s: f64,
    /// The lips part, where the crease between them is found.
    #[arg(long)]
    part_lips: bool,
    /// CSV file to write; the chart is written next to it.
    #[arg(long, default_value = "ratios.csv")]
    csv: PathBuf,
}

/// Heads in other poses.
#[derive(Debug, Args)]
pub(in crate::cli) struct PoseArguments {
    /// Heads: `phantom`, `phantom-long`, `phantom-narrow`, or folders.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Number of poses of each head, turned by up to 45° about each axis.
    #[arg(long, default_value_t = 50)]
    turns: usize,
}

impl PoseArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        Ok(PoseStudy { heads: &self.heads, turns: self.turns }.run(out)?)
    }
}

impl ProposalArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        Ok(ProposalStudy { heads: &self.heads }.run(out)?)
    }
}

impl OperationArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        let Self { heads, cases, only, limit_s, part_lips, csv } = self;
        let (only, mouth, limit_s) = (only.as_deref(), mouth(*part_lips), *limit_s);
        if !(OperationStudy { heads, cases, only, mouth, limit_s, csv }.run(out)?) {
            return Err("a goal is missed: 97 % of solves reliable, slowest within 60 s, median within 10 s".into());
        }
        Ok(())
    }
}

impl AssumptionArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        let Self { heads, operations, only, limit_s, csv } = self;
        Ok(AssumptionStudy { heads, operations, only, limit_s: *limit_s, csv }.run(out)?)
    }
}

impl BudgetArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        let Self { heads, operations, edges_mm, reference_mm, limit_s, csv } = self;
        let (reference_mm, limit_s) = (*reference_mm, *limit_s);
        Ok(BudgetStudy { heads, operations, edges_mm, reference_mm, limit_s, csv }.run(out)?)
    }
}

impl RatioArguments {
    pub(super) fn run(&self, out: &mut dyn Write) -> CommandResult {
        let Self { heads, case, only, limit_s, part_lips, csv } = self;
        let (only, mouth, limit_s) = (only.as_deref(), mouth(*part_lips), *limit_s);
        Ok(RatioStudy { heads, case, only, mouth, limit_s, csv }.run(out)?)
    }
}

fn mouth(part_lips: bool) -> Mouth {
    if part_lips { Mouth::Auto } else { Mouth::Glued }
}
