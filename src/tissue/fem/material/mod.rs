//! Strain energies with stress, tangent and checks of stability. Stresses and moduli are in MPa.
//!
//! Every energy here is isotropic, and it vanishes and is stress-free at rest. How fast it grows depends on its constants:
//! [`Material::is_elliptic`] tests whether a deformation is in the range in which equilibrium is well posed.
//!
//! # Adding a law
//! A law is a variant of [`Isochoric`] (`energy.rs`); the compiler names each `match` that lacks it.
//!
//! - A law of `J^(-2/3) I1` gives its slope and curvature in `Material::derivatives` and its energy in [`Material::energy`];
//!   stress and tangent follow. A law of the principal stretches is like `ogden.rs`: it adds its own stress, tangent and Hessian.
//! - Every law has a [`Material::shear_modulus`], and [`Material::is_polyconvex`] (`ellipticity.rs`) says for which constants it
//!   is stable at every stretch.
//! - In the API (below `src/service`): its name and constants in `contract/material.rs`, their bounds in
//!   `contract/material_check.rs`, its entry of `laws()` in `http/dto/material_view.rs`. Then regenerate `api/openapi.json`.

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
