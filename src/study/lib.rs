//! `prosopon bench …`: the studies behind the charts.
//!
//! Invariants: what is measured is what a user gets, through the same calls; nothing is compared with itself; fixed points and
//! seeds. Times and memory are those of one run on one machine.

mod bounds;
mod chart;
mod collision;
mod contacts;
mod ct;
mod cuts;
mod error;
mod evaluate;
mod field;
mod files;
mod growth;
mod head;
mod model_case;
mod models;
mod operations;
mod process;
mod proposals;
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

pub use bounds::BoundStudy;
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
pub use process::peak_mb;
pub use proposals::ProposalStudy;
pub use reach::ReachStudy;
pub use service::ServiceStudy;
pub use solver_growth::{SlabCase, SolverGrowthStudy, run_slab_case};
pub use stability::StabilityStudy;
pub use truth::TruthStudy;
pub use warm_start::WarmStartStudy;
