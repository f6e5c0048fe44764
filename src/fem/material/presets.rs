use super::energy::Material;
use crate::mesh::Tissue;

/// A material for each tissue.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Materials {
    /// Skin.
    pub skin: Material,
    /// Muscle.
    pub muscle: Material,
    /// Fat.
    pub fat: Material,
    /// Mucosa.
    pub mucosa: Material,
}

/// 1 gf/mm² in MPa.
const GF_PER_MM2: f64 = 9.80665e-3;

/// Wang 2009, Table 1: C10, C01 in gf/mm², and D1 read as Poisson ratio.
const SKIN: [f64; 3] = [18.9834587, -15.4071649, 0.49];
const MUSCLE: [f64; 3] = [9.84540206, -7.74326281, 0.30];
const FAT: [f64; 3] = [16.6131140, -16.0126823, 0.49];

fn published([c10, c01, poisson]: [f64; 3]) -> Material {
    Material::mooney_rivlin(c10 * GF_PER_MM2, c01 * GF_PER_MM2, poisson)
}

fn stable([c10, c01, poisson]: [f64; 3]) -> Material {
    Material::neo_hookean(2.0 * (c10 + c01) * GF_PER_MM2, poisson)
}

fn tension([c10, c01, poisson]: [f64; 3], c2: f64) -> Material {
    Material::yeoh([(c10 + c01) * GF_PER_MM2, c2, 0.0], poisson)
}

impl Materials {
    /// The published constants (Wang 2009, Table 1). C01 is negative: ellipticity is lost when the largest principal stretch exceeds about
    /// 1.110 in skin, 1.128 in muscle, 1.019 in fat. No value is published for mucosa: muscle's is used.
    #[must_use]
    pub fn wang2009() -> Self {
        Self { skin: published(SKIN), muscle: published(MUSCLE), fat: published(FAT), mucosa: published(MUSCLE) }
    }

    /// Neo-Hookean with the published small-strain shear moduli 2 (C10 + C01): 70.142923 kPa in skin, 41.229888 kPa in muscle,
    /// 11.776447 kPa in fat, and the same Poisson ratios. No value is published for mucosa: muscle's is used.
    #[must_use]
    pub fn wang2009_stable() -> Self {
        Self { skin: stable(SKIN), muscle: stable(MUSCLE), fat: stable(FAT), mucosa: stable(MUSCLE) }
    }

    /// Yeoh with the published small-strain shear moduli and the second constant fitted to the published uniaxial curve up to a stretch of 1.2,
    /// which it follows within 13 % in skin, 12 % in muscle, 40 % in fat; the same Poisson ratios. Stable at every stretch.
    #[must_use]
    pub fn wang2009_tension() -> Self {
        // MPa.
        let (skin, muscle, fat) = (tension(SKIN, 0.1401), tension(MUSCLE, 0.0704), tension(FAT, 0.1456));
        Self { skin, muscle, fat, mucosa: muscle }
    }

    /// One material for all tissues.
    #[must_use]
    pub fn homogeneous(material: Material) -> Self {
        Self { skin: material, muscle: material, fat: material, mucosa: material }
    }

    /// The material of `tissue`.
    #[must_use]
    pub fn of(&self, tissue: Tissue) -> &Material {
        match tissue {
            Tissue::Skin => &self.skin,
            Tissue::Muscle => &self.muscle,
            Tissue::Fat => &self.fat,
            Tissue::Mucosa => &self.mucosa,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stable_preset_keeps_the_published_moduli() {
        let (published, stable) = (Materials::wang2009(), Materials::wang2009_stable());
        for (tissue, kpa, poisson) in
            [(Tissue::Skin, 70.142923, 0.49), (Tissue::Muscle, 41.229888, 0.30), (Tissue::Fat, 11.776447, 0.49)]
        {
            for m in [published.of(tissue), stable.of(tissue)] {
                assert!((m.shear_modulus() * 1e3 - kpa).abs() < 1e-6 * kpa, "{}", m.shear_modulus());
                assert!((m.poisson_ratio() - poisson).abs() < 1e-12);
            }
        }
        assert!(stable.skin.is_polyconvex() && !published.skin.is_polyconvex());
        let tension = Materials::wang2009_tension();
        for (material, published, within) in [
            (tension.skin, published.skin, 0.13),
            (tension.muscle, published.muscle, 0.12),
            (tension.fat, published.fat, 0.40),
        ] {
            assert!(
                material.is_polyconvex() && (material.shear_modulus() / published.shear_modulus() - 1.0).abs() < 1e-12
            );
            // Incompressible uniaxial nominal stress: of deviators, so that the volumetric parts drop out.
            let nominal = |m: &Material, l: f64| {
                let p =
                    m.first_piola(&nalgebra::Matrix3::from_diagonal(&[l, l.powf(-0.5), l.powf(-0.5)].into())).unwrap();
                p[(0, 0)] - p[(1, 1)] * l.powf(-1.5)
            };
            for step in 1..=20 {
                let l = 1.0 + 0.01 * f64::from(step);
                let error = nominal(&material, l) / nominal(&published, l) - 1.0;
                assert!(error.abs() < within + 0.01, "{l}: {error}");
            }
        }
        assert_eq!(stable.of(Tissue::Mucosa), stable.of(Tissue::Muscle));
    }
}
