//! Compares, measures and draws surfaces: registration, signed error maps, statistics, named points, pictures.
//!
//! Invariants: a signed error is negative where the prediction lies behind (inside) the reference; a displacement is never
//! called an error.

mod baseline;
mod between;
mod clinical;
mod colour;
mod consistency;
mod distance;
mod error;
mod error_map;
mod font;
mod head;
mod mask;
mod nearest_bone;
mod picture;
mod plausible;
mod png;
mod point_to_plane;
mod raster;
mod regions;
mod register;
mod sheet;
mod smoothing;
mod statistics;
mod tuning;
mod views;

pub use baseline::{BaselineError, baseline_error};
pub use between::between_solutions;
pub use clinical::{BeforeAfter, Clinical, ClinicalInput, NamedPoint, NoRatio, ProfilePiece, SoftToHard, clinical};
pub use colour::diverging;
pub use consistency::{GivenLandmarks, check_landmarks, check_skin_and_bone, check_two_skins};
pub use error::{EvaluateError, RegistrationFault};
pub use error_map::{Correspondence, ErrorMap, error_map};
pub use head::{FrameBasis, HeadFrame, head_frame};
pub use mask::{Mask, MaskRegion};
pub use nearest_bone::{MovedBone, nearest_bone_displacement};
pub use picture::{Layer, MovedAlong, View, moved_along, render_panels};
pub use png::rgb_png;
pub use raster::Coloured;
pub use regions::{FaceRegion, FaceRegions, eyes, face_regions};
pub use register::{Registration, register};
pub use sheet::{Sheet, render_sheet};
pub use statistics::{Statistics, statistics};
pub use views::{ORIENTED_VIEWS, OrientedView, render_views};

#[cfg(test)]
mod registration_tests;
#[cfg(test)]
mod tests;
