//! Requests and answers of the service: one type for each, which is also its stored form.
//!
//! HTTP, jobs, the command line and the store use these types, with one set of defaults and one check that reports all faults
//! of a request together. Invariants: this crate computes nothing and knows no HTTP; a stored document never changes, and new
//! versions only add members.
//!
//! A type that is stored or shared with jobs belongs here. A type that is only sent belongs in `src/service/http/dto`.

mod attachment;
mod baselines;
mod bounds;
mod budget;
mod check;
mod choices;
mod clinical;
mod compare;
mod cut;
mod error_map;
mod fault;
mod fault_from;
mod field;
mod file_faults;
mod frame;
mod json;
mod landmarks;
mod markups;
mod markups_names;
mod material;
mod material_check;
mod mesh;
mod model_name;
mod motion;
mod osteotomy;
mod plan;
mod plan_request;
mod region;
mod registration;
mod report;
mod rotation_request;
mod session;
mod solve;
mod statistics;
mod step;
mod surface;
mod tissue;
mod transform_json;
mod transform_request;
mod volume;
mod warning;

pub use attachment::{AttachedDocument, Attachment, BeyondName, NodeClassName, PaintDocument};
pub use baselines::{BaselineDocument, BaselinesDocument};
pub use bounds::BoxDocument;
pub use budget::{Budget, BudgetDocument, EstimateDocument, ExpectedDocument, TriedDocument};
pub use check::{Check, REACH_MM, short_number};
pub use choices::{PlanChoice, SupersedeChoice, SupersedeForms, SupersedeScopeName};
pub use clinical::{
    BeforeAfterDocument, ClinicalDocument, NamedPointDocument, ProfilePieceDocument, SoftToHardDocument,
};
pub use compare::{
    CheckedCompare, CompareRequest, RegisterOn, RegisterRequest, SessionSurface, SurfaceRef, SurfaceSource, UNMOVED_MM,
};
pub use cut::{
    CutDocument, CutSurfaceDocument, FreePartDocument, PlaneBoundsDocument, PlaneDocument, PolylineDocument,
    PurposeDocument, stored_cuts,
};
pub use error_map::{ErrorDocument, HistogramBin};
pub use fault::{Fault, FaultKind, FieldFault, Halt};
pub use fault_from::{chain, import_fault};
pub use field::{
    DoubtDocument, DoubtfulRegionsDocument, FieldDocument, FieldMethod, FieldQualityDocument, FieldSettingsDocument,
    RegionDocument, Solid,
};
pub use file_faults::FileFaults;
pub use frame::{FrameBasisName, FrameDocument, FrameRequest};
pub use json::{from_json, to_json};
pub use landmarks::{CoordinateSystemName, LandmarksDocument, LandmarksFrame, PlacedPlane};
pub use markups::landmarks_of_file;
pub use material::{
    D1ReadingName, LockingName, MaterialDocument, PresetName, SkinElementName, TissueLawsDocument,
    UnstableMaterialName, VolumetricName,
};
pub use material_check::check_material;
pub use mesh::{MeshDocument, MeshRequest, MouthDocument};
pub use model_name::ModelName;
pub use motion::{motion_from, motion_parts};
pub use osteotomy::{
    ClearanceDocument, CreateOsteotomy, Cuts, OsteotomyDocument, ProtectedRequest, SegmentDocument, TemplateName,
    TemplateRequest,
};
pub use plan::{PathDocument, PathReportDocument, PathSample, PlanDocument, WaypointDocument};
pub use plan_request::{Autorotate, CheckedPlan, CreatePlan, Hinge, PathRequest, Segments, WaypointRequest};
pub use region::RegionRequest;
pub use registration::RegistrationDocument;
pub use report::{PhasesDocument, ReportDocument, ReportInput};
pub use rotation_request::{AxisAngle, PitchRollYaw, RotationRequest, segment_motion};
pub use session::{CreateSession, MAX_STEPS, SessionSettings};
pub use solve::{OutputName, SolveRequest, SolverOptions};
pub use statistics::StatisticsDocument;
pub use step::{LeftOutDocument, ReactionDocument, RegionMotionDocument, StepDocument, StepPhasesDocument};
pub use surface::{OriginKind, SurfaceDocument, SurfaceOrigin};
pub use tissue::TissueDocument;
pub use transform_request::{TransformDirection, TransformFileRequest};
pub use volume::{CtDocument, LevelsDocument, VolumeDocument};
pub use warning::{Findings, SeverityName, WarningDocument};
