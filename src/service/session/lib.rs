//! Contents of a patient session, their dependencies, and the numerics behind them.
//!
//! Invariants: this crate knows no HTTP; numerics are reached through [`Engine`] only; every derived part has a key made from
//! everything that it was derived from, so that it can be deleted and rebuilt identically.

mod case;
mod checkpoint_file;
mod clinical;
mod engine;
mod error_sheet;
mod framed;
mod inputs;
mod kept;
mod keys;
mod numerics;
mod path_solve;
mod profile_picture;
mod recent;
mod scene;
mod surface_part;
mod tissue_file;

pub use case::{Case, Earlier, Run, SceneBones, SceneRun, TissueRequest};
pub use checkpoint_file::StoredCheckpoint;
pub use engine::{Engine, OtherSurface, RunWatch, SceneSolved};
pub use error_sheet::{ERROR_LIMIT_MM, error_sheet};
pub use inputs::{SessionParts, load_mesh, read_part};
pub use kept::Kept;
pub use keys::key_of;
pub use numerics::Numerics;
pub use profile_picture::{profile_drawing, profile_picture};
pub use surface_part::{PreparedSurface, surface_part};
