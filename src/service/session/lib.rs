//! Contents of a patient session, their dependencies, and the numerics behind them.
//!
//! Invariants: this crate knows no HTTP; numerics are reached through [`Engine`] only; every derived part has a key made from
//! everything that it was derived from, so that it can be deleted and rebuilt identically.

mod case;
mod course;
mod documents;
mod engine;
mod error_sheet;
mod fault;
mod fault_from;
mod inputs;
mod keys;
mod landmarks;
mod milestone_file;
mod motion;
mod numerics;
mod recent;
mod scene;
mod settings;
mod surface_part;
mod tissue_file;

pub use case::{Case, Cuts, Earlier, Run, SceneBones, SceneRun, Solid, TissueRequest};
pub use documents::{
    AttachedDocument, ClearanceDocument, CtDocument, CutDocument, CutSurfaceDocument, D1ReadingName, DoubtDocument,
    DoubtfulRegionsDocument, ErrorDocument, FieldDocument, FieldQualityDocument, FreePartDocument, HistogramBin,
    LeftOutDocument, LockingName, MaterialDocument, MeshDocument, NodeClassName, OsteotomyDocument, PaintDocument,
    PathDocument, PathReportDocument, PathSample, PhasesDocument, PlanDocument, PlaneBoundsDocument, PlaneDocument,
    PolylineDocument, PresetName, PurposeDocument, ReactionDocument, RegionDocument, RegionMotionDocument,
    RegistrationDocument, ReportDocument, ReportInput, SegmentDocument, SkinElementName, StatisticsDocument,
    StepDocument, StepPhasesDocument, SurfaceDocument, SurfaceOrigin, TissueDocument, TissueLawsDocument,
    UnstableMaterialName, VolumetricName, WaypointDocument, stored_cuts,
};
pub use engine::{Engine, RunWatch, SceneSolved};
pub use error_sheet::error_sheet;
pub use fault::{Fault, FaultKind, FieldFault, Halt};
pub use fault_from::{chain, import_fault};
pub use inputs::{SessionParts, load_mesh, read_part};
pub use keys::key_of;
pub use landmarks::{LandmarksDocument, PlacedPlane};
pub use milestone_file::StoredMilestone;
pub use motion::{motion_from, motion_parts};
pub use numerics::Numerics;
pub use settings::{BoxDocument, FieldMethod, FieldSettingsDocument, MeshSettingsDocument};
pub use surface_part::{PreparedSurface, surface_part};
