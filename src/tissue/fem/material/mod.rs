//! Strain energies with stress, tangent and checks of stability. Stresses and moduli are in MPa.
//!
//! Every energy here is isotropic, and it vanishes and is stress-free at rest. How fast it grows depends on its constants:
//! [`Material::is_elliptic`] tests whether a deformation is in the range in which equilibrium is well posed.

mod ellipticity;
mod energy;
mod ogden;
mod path_check;
mod presets;
mod principal;
mod principal_hessian;
mod projection;
mod stable_range;
mod tangent;

pub use energy::{Isochoric, Material, Volumetric};
pub use path_check::PathCheck;
pub use presets::{D1Reading, Materials};
pub use stable_range::{EXPECTED_SHEAR, EXPECTED_STRETCH, StandardTest};
pub use tangent::{Inverted, Tangent};
