//! Computations: CPU pools, long jobs with their states and events, and short tasks within a request.
//!
//! Invariants: numerics run on [`CpuPool`] only; a job is stored before a client learns of it; a step becomes visible only when
//! it is complete; each worker computes one job at a time; a cancelled job never succeeds. When the service stops, its running
//! jobs are continued by its next start or by another process on the same store.

mod budget;
mod cpu_pool;
mod events;
mod feed;
mod forecast;
mod frame;
mod health;
mod heartbeat;
mod janitor;
mod kept;
mod lease;
mod memory;
mod order;
mod others;
mod persist;
mod queue;
mod recovery;
mod requests;
mod running;
mod service;
mod settings;
mod start;
mod state;
mod status;
mod tasks;
mod transition;
mod work;
mod worker;

pub mod trace;

pub use budget::demand_of;
pub use cpu_pool::{CpuPool, Panicked};
pub use feed::EventFeed;
pub use frame::SkinFrame;
pub use health::StuckComputation;
pub use janitor::Scrubbed;
pub use kept::{case_of, is_kept};
pub use order::Order;
pub use requests::{
    CompareTask, EarlierSolve, FieldTask, Given, ImportRequest, MeshChoice, MeshTask, SceneTask, SolveTask,
};
pub use running::phase_names;
pub use service::Service;
pub use settings::ServiceSettings;
pub use state::{Illegal, JobEvent, next};
pub use status::JobStatus;
pub use tasks::{
    BoneBelow, Compared, Comparison, CtScan, FaceAnchors, NamedSurface, Prediction, Predictions, StoredComparison,
    compare, cut_bone, cut_off_stl, face_of, field_slice, frame_of, landmark_warnings, make_plan, measure_plan,
    named_surface, place_cuts, propose_landmarks, read_comparison, read_frame, rest_of, take_ct, take_surface,
    take_tissue,
};
