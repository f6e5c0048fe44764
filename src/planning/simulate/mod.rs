//! From a patient's surfaces and a plan to steps of deformed skin.
//!
//! Invariants: no HTTP and no storage; results depend on nothing but the inputs and settings.

mod attach;
mod bone;
pub mod budget;
mod cartilage;
mod error;
mod fields;
mod globes;
mod mouth;
mod outer_surface;
mod pressed_globes;
mod reach;
mod ready_mesh;
mod run;
mod scene;
mod skin_mover;
mod tissue;
mod tuning;

pub use attach::{Attached, AttachmentRules, Beyond, NodeClass, Paint, SkullPaint};
pub use bone::{CutBone, cut_bone, segment_fields};
pub use error::SimulateError;
pub use fields::{Anatomy, Fields, FieldsSettings, build_fields, build_fields_around};
pub use globes::Globe;
pub use mouth::Mouth;
pub use outer_surface::OuterSurface;
pub use pressed_globes::globe_warnings;
pub use reach::displacement_class_mm;
pub use ready_mesh::{CellIndex, READY_MESH_LOCKING, ReadyMesh, ReadyMeshError};
pub use run::{
    Frame, HEAD_LOCKING, LEAVE_OUT_BELOW_MM, LeftOut, OnFrame, Outcome, PathCheckpoint, PathStart, PreparedTissue,
    RegionMotion, RunSettings, solve, solve_prepared,
};
pub use scene::{OnStep, Scene, SceneOutcome};
pub use tissue::{TissueModel, TissueSettings, build_tissue, region_warning};
