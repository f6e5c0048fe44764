//! Views of stored records and jobs, and the queries of requests: types that are only sent.
//!
//! Types that are stored or shared with jobs are in `prosopon_contract`, as are the bodies of most requests.

mod compare;
mod event;
mod inputs;
mod job;
mod link;
mod material_view;
mod mesh;
mod osteotomy;
mod plan;
mod session;

pub(super) use compare::finite;
pub use compare::{CompareView, ErrorView};
pub(super) use event::render_event;
pub use event::{
    EndEvent, EndLinks, JobEvent, JobEventLine, NoData, ProgressEvent, ResyncEvent, SentEvent, StatusEvent, StepEvent,
    StepLinks,
};
pub(super) use inputs::import_request;
pub use inputs::{
    CtAccepted, CtQuery, FieldView, LandmarksQuery, PointQuery, PointValues, SliceAxis, SliceQuery, UploadForm,
};
pub(super) use job::statuses;
pub use job::{JobLinks, JobList, JobView};
pub use link::{CreateLink, LinkView};
pub use material_view::{
    CheckMaterial, Criterion, LawView, LossView, MaterialCheck, MaterialView, MaterialsList, MaterialsQuery,
    ModuliView, PresetView, StableRangeView, TestMode, TestView,
};
pub use mesh::MeshView;
pub use osteotomy::{OsteotomyList, OsteotomyPreview, OsteotomyView, TemplateList, TemplateView};
pub use plan::{PlanList, PlanView};
pub(super) use session::view_of;
pub use session::{PartView, SessionList, SessionView};
