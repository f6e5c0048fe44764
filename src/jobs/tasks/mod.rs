//! Work that is done within a request, computed on the pool all the same.

mod bone;
mod compare;
mod results;
mod slice;
mod surface;
mod tissue;
mod volume;

pub use bone::{cut_bone, make_plan, propose_landmarks};
pub use compare::{Compared, Comparison, Prediction, RegisterOn, UNMOVED_MM, compare};
pub use results::{read_frame, rest_of};
pub use slice::field_slice;
pub use surface::take_surface;
pub use tissue::take_tissue;
pub use volume::{CtScan, take_ct};
