//! Documents: results in their stored and served form.
//!
//! A stored document never changes, and new versions only add members.

mod attachment;
mod bone;
mod error_map;
mod field;
mod material;
mod mesh;
mod registration;
mod report;
mod solve;
mod surface;
mod tissue;

pub use attachment::{AttachedDocument, NodeClassName, PaintDocument};
pub use bone::{
    ClearanceDocument, CutDocument, CutSurfaceDocument, FreePartDocument, OsteotomyDocument, PathDocument,
    PathReportDocument, PathSample, PlanDocument, PlaneBoundsDocument, PlaneDocument, PolylineDocument,
    PurposeDocument, SegmentDocument, WaypointDocument, stored_cuts,
};
pub use error_map::{ErrorDocument, HistogramBin, StatisticsDocument};
pub use field::{DoubtDocument, DoubtfulRegionsDocument, FieldDocument, FieldQualityDocument, RegionDocument};
pub use material::{
    D1ReadingName, LockingName, MaterialDocument, PresetName, SkinElementName, TissueLawsDocument,
    UnstableMaterialName, VolumetricName,
};
pub use mesh::MeshDocument;
pub use registration::RegistrationDocument;
pub use report::{PhasesDocument, ReportDocument, ReportInput};
pub use solve::{LeftOutDocument, ReactionDocument, RegionMotionDocument, StepDocument, StepPhasesDocument};
pub use surface::{CtDocument, SurfaceDocument, SurfaceOrigin};
pub use tissue::TissueDocument;
