//! Work that computes: the CPU pools, long jobs with their states and events, and short tasks within a request.
//!
//! Invariants: numerics run on [`CpuPool`] only; a job is stored before anyone hears of it; a step is visible only when
//! it is whole; one job computes at a time; a stopped service leaves jobs that the next start takes up.

mod cpu_pool;
mod feed;
mod frame;
mod physics;
mod requests;
mod running;
mod service;
mod state;
mod tasks;
mod work;
mod worker;

pub use cpu_pool::{CpuPool, Panicked};
pub use feed::EventFeed;
pub use frame::SkinFrame;
pub use physics::{PhysicsRecord, SolveModel};
pub use requests::{AttachmentRecord, FieldRequest, ImportRequest, MeshRequest, SceneRequest, SolveRequest};
pub use service::{JobStatus, Service, ServiceSettings};
pub use state::{Illegal, JobEvent, next};
pub use tasks::{
    Compared, Comparison, CtScan, Prediction, RegisterOn, UNMOVED_MM, compare, cut_bone, field_slice, make_plan,
    propose_landmarks, read_frame, rest_of, take_ct, take_surface, take_tissue,
};
