use super::check::Check;
use super::material::{MaterialDocument, TissueLawsDocument};

use prosopon_tissue::fem::material::Material;

/// Largest accepted modulus, MPa; far stiffer than any tissue.
const MAX_MPA: f64 = 1e6;
/// Smallest accepted shear modulus, MPa; far softer than any tissue, and well above rounding errors.
const MIN_SHEAR_MPA: f64 = 1e-9;
/// Smallest and largest accepted Poisson ratio.
const POISSON: [f64; 2] = [-0.99, 0.4999];
/// Largest magnitude of the Ogden exponent; powers of stretches stay finite.
const MAX_ALPHA: f64 = 100.0;
/// Smallest magnitude of the Ogden exponent; closer to 0, rounding errors dominate the energy.
///
/// The energy then tends to that of a logarithmic law and loses all digits.
const MIN_ALPHA: f64 = 0.1;

/// Builds the material of a document and adds faults to `check` under `pointer`.
pub fn check_material(check: &mut Check, pointer: &str, document: &MaterialDocument) -> Material {
    let (constants, poisson): (&[(&str, f64)], f64) = match *document {
        MaterialDocument::MooneyRivlin { c10_mpa, c01_mpa, poisson, .. } => {
            (&[("c10_mpa", c10_mpa), ("c01_mpa", c01_mpa)], poisson)
        }
        MaterialDocument::NeoHookean { shear_modulus_mpa, poisson, .. }
        | MaterialDocument::Ogden { shear_modulus_mpa, poisson, .. } => {
            (&[("shear_modulus_mpa", shear_modulus_mpa)], poisson)
        }
        MaterialDocument::Yeoh { c1_mpa, c2_mpa, c3_mpa, poisson, .. } => {
            (&[("c1_mpa", c1_mpa), ("c2_mpa", c2_mpa), ("c3_mpa", c3_mpa)], poisson)
        }
    };
    for (name, value) in constants {
        check.number(&format!("{pointer}/{name}"), *value, -MAX_MPA, MAX_MPA);
    }
    if let MaterialDocument::Ogden { alpha, .. } = *document
        && !(MIN_ALPHA..=MAX_ALPHA).contains(&alpha.abs())
    {
        let detail = format!("is {alpha}, allowed is a magnitude of {MIN_ALPHA} to {MAX_ALPHA} of either sign");
        check.fault(format!("{pointer}/alpha"), detail);
    }
    check.number(&format!("{pointer}/poisson"), poisson, POISSON[0], POISSON[1]);
    let material = Material::from(document);
    let shear = material.shear_modulus();
    if shear < MIN_SHEAR_MPA {
        check.fault(
            pointer,
            format!("the shear modulus at rest is {shear:e} MPa, it must be at least {MIN_SHEAR_MPA:e} MPa"),
        );
    }
    material
}

/// Checks the laws of all tissues; faults go to `check` under `pointer`.
pub(super) fn check_laws(check: &mut Check, pointer: &str, laws: &TissueLawsDocument) {
    for (name, _, law) in laws.given() {
        check_material(check, &format!("{pointer}/{name}"), law);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FileFaults, VolumetricName};

    #[test]
    fn faults_of_a_material_name_their_place() {
        let checked = |document: MaterialDocument| {
            let mut check = Check::default();
            let material = check_material(&mut check, "/m", &document);
            FileFaults::finish(check).map(|()| material)
        };
        let volumetric = VolumetricName::default();
        let material = |c10_mpa, c01_mpa, poisson| {
            checked(MaterialDocument::MooneyRivlin { c10_mpa, c01_mpa, poisson, volumetric })
        };
        let good = material(0.004, 0.001, 0.45).unwrap();
        assert!((good.shear_modulus() - 0.01).abs() < 1e-15 && (good.poisson_ratio() - 0.45).abs() < 1e-12);
        let ogden =
            |alpha| checked(MaterialDocument::Ogden { shear_modulus_mpa: 0.1, alpha, poisson: 0.4, volumetric });
        assert!(ogden(-3.0).is_ok());
        for (fault, expected) in [
            (material(0.004, 0.001, 0.5), "/m/poisson is 0.5"),
            (material(0.004, -0.004, 0.45), "/m the shear modulus at rest is 0e0 MPa"),
            (material(1e-300, 0.0, 0.45), "/m the shear modulus at rest is 2e-300 MPa"),
            (material(f64::NAN, 0.001, 0.45), "/m/c10_mpa is"),
            (ogden(0.0), "/m/alpha is 0"),
            (ogden(f64::NAN), "/m/alpha is NaN"),
        ] {
            let text = fault.unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }
}
