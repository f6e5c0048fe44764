//! Strain energies with stress, tangent and a check of stability. MPa.
//!
//! Every energy here is isotropic, vanishes and is stress-free at rest, and grows without bound only as far as its constants
//! allow: [`Material::is_elliptic`] tells where a deformation has left the range in which equilibrium is well posed.

mod ellipticity;
mod energy;
mod ogden;
mod path_check;
mod presets;
mod principal;
mod projection;
mod stable_range;

pub use energy::{Inverted, Isochoric, Material, Tangent, Volumetric};
pub use path_check::PathCheck;
pub use presets::{D1Reading, Materials};
pub use stable_range::{EXPECTED_SHEAR, EXPECTED_STRETCH, StandardTest};
