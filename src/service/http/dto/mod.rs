//! JSON documents of requests and answers, and the checks that turn requests into domain values.

mod bone;
mod check;
mod compare;
mod event;
mod file_faults;
mod inputs;
mod job;
mod material;
mod material_view;
mod mesh;
mod plan;
mod session;

pub use bone::{
    CreateOsteotomy, CutRequest, OsteotomyList, OsteotomyView, ProtectedRequest, TemplateName, TemplateRequest,
};
pub(super) use compare::{CheckedCompare, finite};
pub use compare::{CompareRequest, CompareView, ErrorView, PartName, PartRequest, RegisterRequest, SurfaceRef};
pub(super) use event::render_event;
pub use file_faults::FileFaults;
pub(super) use inputs::import_request;
pub use inputs::{
    CtQuery, FieldView, LandmarksQuery, PointQuery, PointValues, PutFieldSettings, PutLandmarks, SliceAxis, SliceQuery,
    SolidName,
};
pub(super) use job::CheckedJob;
pub use job::{AttachmentRequest, Budget, CreateJob, JobList, JobView, ModelName, OutputName};
pub use material::file_material;
pub use material_view::{
    CheckMaterial, Criterion, LawView, LossView, MaterialCheck, MaterialView, MaterialsList, MaterialsQuery,
    ModuliView, PresetView, StableRangeView, TestMode, TestView,
};
pub use mesh::{BuildMesh, MeshView};
pub(super) use plan::Segments;
pub use plan::segment_motion;
pub use plan::{
    Autorotate, AxisAngle, CreatePlan, Hinge, PathRequest, PitchRollYaw, PlanList, PlanView, RotationRequest,
    WaypointRequest,
};
pub(super) use session::view_of;
pub use session::{CreateSession, PartView, SessionList, SessionSettings, SessionView};
