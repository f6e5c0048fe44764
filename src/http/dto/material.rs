use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::check::Check;
use crate::fem::material::Material;

/// Largest modulus that is read, MPa: stiffer than any tissue by far.
const MAX_MPA: f64 = 1e6;
/// Largest Poisson ratio that is read.
const MAX_POISSON: f64 = 0.4999;

/// A compressible material: an isochoric law and `K/2 (J - 1)²` with the bulk modulus that gives the Poisson ratio at rest.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(tag = "law", rename_all = "snake_case", deny_unknown_fields)]
pub enum MaterialRequest {
    /// `c10 (J^(-2/3) I1 - 3) + c01 (J^(-4/3) I2 - 3)`.
    MooneyRivlin {
        /// C10, MPa.
        c10_mpa: f64,
        /// C01, MPa.
        c01_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
    },
    /// `mu/2 (J^(-2/3) I1 - 3)`.
    NeoHookean {
        /// Shear modulus mu, MPa.
        shear_modulus_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
    },
    /// `c1 f + c2 f² + c3 f³` with `f = J^(-2/3) I1 - 3`.
    Yeoh {
        /// C1, MPa.
        c1_mpa: f64,
        /// C2, MPa.
        #[serde(default)]
        c2_mpa: f64,
        /// C3, MPa.
        #[serde(default)]
        c3_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
    },
}

impl MaterialRequest {
    /// The material; faults go to `check` under `pointer`.
    pub(in crate::http) fn check(&self, check: &mut Check, pointer: &str) -> Material {
        let mut modulus = |name: &str, value: f64| check.number(&format!("{pointer}/{name}"), value, -MAX_MPA, MAX_MPA);
        let (material, poisson) = match *self {
            Self::MooneyRivlin { c10_mpa, c01_mpa, poisson } => {
                (Material::mooney_rivlin(modulus("c10_mpa", c10_mpa), modulus("c01_mpa", c01_mpa), poisson), poisson)
            }
            Self::NeoHookean { shear_modulus_mpa, poisson } => {
                (Material::neo_hookean(modulus("shear_modulus_mpa", shear_modulus_mpa), poisson), poisson)
            }
            Self::Yeoh { c1_mpa, c2_mpa, c3_mpa, poisson } => {
                let constants = [modulus("c1_mpa", c1_mpa), modulus("c2_mpa", c2_mpa), modulus("c3_mpa", c3_mpa)];
                (Material::yeoh(constants, poisson), poisson)
            }
        };
        if !(poisson > -1.0 && poisson <= MAX_POISSON) {
            check.fault(
                format!("{pointer}/poisson"),
                format!("is {poisson}, allowed is above -1 and at most {MAX_POISSON}"),
            );
        }
        if material.shear_modulus() <= 0.0 {
            let detail = format!("the shear modulus at rest is {} MPa, it must be positive", material.shear_modulus());
            check.fault(pointer, detail);
        }
        material
    }

    /// The material of a file that is no request: all faults in one text.
    ///
    /// # Errors
    /// [`FileFaults`].
    pub fn material(&self, pointer: &str) -> Result<Material, FileFaults> {
        let mut check = Check::default();
        let material = self.check(&mut check, pointer);
        FileFaults::finish(check).map(|()| material)
    }
}

/// Values of a file that are not allowed, each with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileFaults(Vec<(String, String)>);

impl FileFaults {
    pub(super) fn finish(check: Check) -> Result<(), Self> {
        let Err(fault) = check.finish() else { return Ok(()) };
        Err(Self(fault.errors.into_iter().map(|e| (e.pointer, e.detail)).collect()))
    }
}

impl fmt::Display for FileFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (pointer, detail)) in self.0.iter().enumerate() {
            let comma = if index > 0 { ", " } else { "" };
            write!(f, "{comma}{pointer} {detail}")?;
        }
        Ok(())
    }
}

impl std::error::Error for FileFaults {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_a_material_name_their_place() {
        let material =
            |c10_mpa, c01_mpa, poisson| MaterialRequest::MooneyRivlin { c10_mpa, c01_mpa, poisson }.material("/m");
        let good = material(0.004, 0.001, 0.45).unwrap();
        assert!((good.shear_modulus() - 0.01).abs() < 1e-15 && (good.poisson_ratio() - 0.45).abs() < 1e-12);
        for (fault, expected) in [
            (material(0.004, 0.001, 0.5), "/m/poisson is 0.5"),
            (material(0.004, -0.004, 0.45), "/m the shear modulus at rest is 0 MPa"),
            (material(f64::NAN, 0.001, 0.45), "/m/c10_mpa is"),
        ] {
            let text = fault.unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }
}
