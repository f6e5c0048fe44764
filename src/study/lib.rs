//! The studies of `prosopon bench …`, which measure the library and draw the charts.
//!
//! Invariants: a study measures the calls that a user makes; no method is its own reference; test points and random seeds are
//! fixed. Times and memory come from one run on one machine.

mod assumptions;
mod bounds;
mod budget;
mod chart;
mod collision;
mod contacts;
mod ct;
mod cuts;
mod end_skin;
mod error;
mod evaluate;
mod field;
mod files;
mod growth;
mod head;
mod model_case;
mod models;
mod operations;
mod pareto_chart;
mod poses;
mod process;
mod proposals;
mod ratios;
mod reach;
mod row;
mod scan;
mod service;
mod slab;
mod solver_growth;
mod stability;
mod truth;
mod warm_start;
mod winding;

pub use assumptions::AssumptionStudy;
pub use bounds::BoundStudy;
pub use budget::BudgetStudy;
pub use collision::CollisionStudy;
pub use contacts::ContactStudy;
pub use ct::{CtConversion, CtSurfaceStudy, load_ct, read_ct};
pub use cuts::CutStudy;
pub use error::{BenchError, PointsFault};
pub use evaluate::evaluate;
pub use field::FieldStudy;
pub use growth::GrowthStudy;
pub use head::HeadSource;
pub use model_case::{ModelCase, run_model_cases};
pub use models::ModelStudy;
pub use operations::OperationStudy;
pub use poses::PoseStudy;
pub use process::peak_mb;
pub use proposals::ProposalStudy;
pub use ratios::RatioStudy;
pub use reach::ReachStudy;
pub use service::ServiceStudy;
pub use solver_growth::{SlabCase, SolverGrowthStudy, run_slab_case};
pub use stability::StabilityStudy;
pub use truth::TruthStudy;
pub use warm_start::WarmStartStudy;
