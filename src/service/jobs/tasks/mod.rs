//! Short tasks within a request, computed on the threads for requests.

mod baselines;
mod bone;
mod checks;
mod compare;
mod face;
mod named_surface;
mod predictions;
mod results;
mod slice;
mod surface;
mod tissue;
mod volume;

pub use baselines::BoneBelow;
pub(super) use baselines::{Mapped, baselines, follow_bone};
pub(crate) use bone::measured;
pub use bone::{cut_bone, frame_of, make_plan, measure_plan, place_cuts, propose_landmarks};
pub(crate) use checks::input_warnings;
pub use checks::landmark_warnings;
pub use compare::{Compared, Comparison, Prediction, compare};
pub use face::{FaceAnchors, face_of};
pub(super) use named_surface::load_surface;
pub use named_surface::{NamedSurface, named_surface};
pub use predictions::Predictions;
pub use results::{StoredComparison, read_comparison, read_frame, rest_of};
pub use slice::field_slice;
pub use surface::{cut_off_stl, take_surface};
pub use tissue::take_tissue;
pub use volume::{CtScan, take_ct};
