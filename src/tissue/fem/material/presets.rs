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
    /// Cartilage of the nose.
    pub cartilage: Material,
}

/// 1 gf/mm² in MPa.
const GF_PER_MM2: f64 = 9.80665e-3;

/// Wang 2009, Table 1: C10, C01 in gf/mm², and D1 read as Poisson ratio.
const SKIN: [f64; 3] = [18.9834587, -15.4071649, 0.49];
const MUSCLE: [f64; 3] = [9.84540206, -7.74326281, 0.30];
const FAT: [f64; 3] = [16.6131140, -16.0126823, 0.49];

/// Young's modulus of nasal cartilage, MPa.
///
/// Abstracts give 0.98 (lateral), 2.09 (alar) and 2.72 (septum) in compression (Griffin et al., J Mater Sci Mater Med 27, 2016)
/// and 3.01 for the septum in tension at equilibrium (Richmon et al., Am J Rhinol 19, 2005); the full papers were not read. The
/// lower end is taken, because elements of 4 mm draw the plates about twice as thick as they are.
const CARTILAGE_YOUNG_MPA: f64 = 1.0;
/// Poisson ratio of cartilage: a choice, near incompressible but low enough that linear elements do not lock.
const CARTILAGE_POISSON: f64 = 0.45;

fn cartilage() -> Material {
    Material::neo_hookean(0.5 * CARTILAGE_YOUNG_MPA / (1.0 + CARTILAGE_POISSON), CARTILAGE_POISSON)
}

/// Meaning of `D1` in Wang 2009, Table 1, which the paper does not state (`src/paper.md`, 19).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum D1Reading {
    /// The Poisson ratio: 0.49, 0.30, 0.49 of skin, muscle, fat.
    #[default]
    PoissonRatio,
    /// `2/K` in 1/MPa, although the other constants are in gf/mm²: Poisson ratios 0.4915, 0.4969, 0.4986.
    PerMpa,
    /// `2/K` in mm²/gf: Poisson ratios -0.053, 0.240, 0.366, which no soft tissue has.
    Mm2PerGf,
}

fn published([c10, c01, d1]: [f64; 3], reading: D1Reading) -> Material {
    let at = |poisson| Material::mooney_rivlin(c10 * GF_PER_MM2, c01 * GF_PER_MM2, poisson);
    match reading {
        D1Reading::PoissonRatio => at(d1),
        D1Reading::PerMpa => Material { bulk: 2.0 / d1, ..at(0.0) },
        D1Reading::Mm2PerGf => Material { bulk: 2.0 / d1 * GF_PER_MM2, ..at(0.0) },
    }
}

fn stable([c10, c01, poisson]: [f64; 3]) -> Material {
    Material::neo_hookean(2.0 * (c10 + c01) * GF_PER_MM2, poisson)
}

fn tension([c10, c01, poisson]: [f64; 3], c2: f64) -> Material {
    Material::yeoh([(c10 + c01) * GF_PER_MM2, c2, 0.0], poisson)
}

impl Materials {
    /// [`Materials::wang2009_reading`] with D1 as Poisson ratio.
    #[must_use]
    pub fn wang2009() -> Self {
        Self::wang2009_reading(D1Reading::PoissonRatio)
    }

    /// The published constants (Wang 2009, Table 1).
    ///
    /// C01 is negative: ellipticity is lost when the largest principal stretch exceeds about 1.110 in skin, 1.128 in muscle and
    /// 1.019 in fat, for every reading of D1. No value is published for mucosa; it gets that of muscle.
    #[must_use]
    pub fn wang2009_reading(d1: D1Reading) -> Self {
        let of = |constants| published(constants, d1);
        Self { skin: of(SKIN), muscle: of(MUSCLE), fat: of(FAT), mucosa: of(MUSCLE), cartilage: cartilage() }
    }

    /// Passive tissue of the face, without cartilage, as one Yeoh material: C1 2.5 kPa, C2 1.175 kPa.
    ///
    /// # Source
    /// Measured on a cheek by indentation (Gerard, Ohayon, Luboz, Perrier and Payan, Med Eng Phys 27, 2005); used for a whole
    /// face by Nazari, Perrier, Chabanas and Payan, Comput Methods Biomech Biomed Eng 13, 2010. The Poisson ratio 0.49 is chosen
    /// here for near incompressibility.
    #[must_use]
    pub fn nazari2010() -> Self {
        Self { cartilage: cartilage(), ..Self::homogeneous(Material::yeoh([2.5e-3, 1.175e-3, 0.0], 0.49)) }
    }

    /// Passive tissue of the face, without cartilage, with Young's modulus 15 kPa and Poisson ratio 0.49.
    ///
    /// The moduli are published for small strains and used here in a neo-Hookean material. The stiffer fibres that the source
    /// gives to muscles are left out.
    ///
    /// # Source
    /// Chabanas, Luboz and Payan, Med Image Anal 7, 2003.
    #[must_use]
    pub fn chabanas2003() -> Self {
        let (young, poisson) = (15e-3, 0.49);
        Self {
            cartilage: cartilage(),
            ..Self::homogeneous(Material::neo_hookean(0.5 * young / (1.0 + poisson), poisson))
        }
    }

    /// Neo-Hookean with the published small-strain shear moduli 2 (C10 + C01) and Poisson ratios.
    ///
    /// The shear moduli are 70.142923 kPa in skin, 41.229888 kPa in muscle and 11.776447 kPa in fat. No value is published for
    /// mucosa; it gets that of muscle.
    #[must_use]
    pub fn wang2009_stable() -> Self {
        Self {
            skin: stable(SKIN),
            muscle: stable(MUSCLE),
            fat: stable(FAT),
            mucosa: stable(MUSCLE),
            cartilage: cartilage(),
        }
    }

    /// Yeoh with the published small-strain moduli, fitted to the published uniaxial curve.
    ///
    /// The second constant is fitted up to a stretch of 1.2, within 13 % in skin, 12 % in muscle and 40 % in fat. Stable at every
    /// stretch.
    #[must_use]
    pub fn wang2009_tension() -> Self {
        // MPa.
        let (skin, muscle, fat) = (tension(SKIN, 0.1401), tension(MUSCLE, 0.0704), tension(FAT, 0.1456));
        Self { skin, muscle, fat, mucosa: muscle, cartilage: cartilage() }
    }

    /// The same material for all tissues.
    #[must_use]
    pub fn homogeneous(material: Material) -> Self {
        Self { skin: material, muscle: material, fat: material, mucosa: material, cartilage: material }
    }

    /// Sets the material of `tissue`.
    pub fn set(&mut self, tissue: Tissue, material: Material) {
        *match tissue {
            Tissue::Skin => &mut self.skin,
            Tissue::Muscle => &mut self.muscle,
            Tissue::Fat => &mut self.fat,
            Tissue::Mucosa => &mut self.mucosa,
            Tissue::Cartilage => &mut self.cartilage,
        } = material;
    }

    /// The material of `tissue`.
    #[must_use]
    pub fn of(&self, tissue: Tissue) -> &Material {
        match tissue {
            Tissue::Skin => &self.skin,
            Tissue::Muscle => &self.muscle,
            Tissue::Fat => &self.fat,
            Tissue::Mucosa => &self.mucosa,
            Tissue::Cartilage => &self.cartilage,
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
            // Incompressible uniaxial nominal stress from deviators, so that the volumetric parts cancel.
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

    /// Poisson ratios of `src/paper.md`, 19; for the last, (3 K - 2 mu) / (2 (3 K + mu)) by hand.
    #[test]
    fn readings_of_d1_give_the_known_poisson_ratios_and_the_same_shear() {
        for (reading, ratios) in [
            (D1Reading::PoissonRatio, [0.49, 0.30, 0.49]),
            (D1Reading::PerMpa, [0.4915, 0.4969, 0.4986]),
            (D1Reading::Mm2PerGf, [-0.0531, 0.2394, 0.3660]),
        ] {
            let m = Materials::wang2009_reading(reading);
            for ((material, same), expected) in [m.skin, m.muscle, m.fat].iter().zip([SKIN, MUSCLE, FAT]).zip(ratios) {
                assert!((material.poisson_ratio() - expected).abs() < 5e-4, "{}", material.poisson_ratio());
                assert_eq!(material.isochoric, published(same, D1Reading::PoissonRatio).isochoric);
            }
        }
    }

    #[test]
    fn cartilage_has_the_same_modulus_in_every_preset() {
        let presets = [Materials::wang2009(), Materials::wang2009_stable(), Materials::wang2009_tension()];
        for m in presets.into_iter().chain([Materials::nazari2010(), Materials::chabanas2003()]) {
            let found = m.of(Tissue::Cartilage);
            assert!((2.0 * found.shear_modulus() * (1.0 + found.poisson_ratio()) - 1.0).abs() < 1e-12);
            assert!((found.poisson_ratio() - 0.45).abs() < 1e-12 && found.is_polyconvex());
        }
        let same = Materials::homogeneous(Materials::chabanas2003().fat);
        assert_eq!(same.cartilage, same.fat);
    }

    #[test]
    fn presets_of_the_literature_have_the_published_moduli() {
        let chabanas = Materials::chabanas2003().fat;
        assert!((2.0 * chabanas.shear_modulus() * (1.0 + chabanas.poisson_ratio()) - 15e-3).abs() < 1e-12);
        let nazari = Materials::nazari2010();
        assert!((nazari.skin.shear_modulus() - 5e-3).abs() < 1e-15 && nazari.skin == nazari.mucosa);
        for preset in [Materials::nazari2010(), Materials::chabanas2003()] {
            assert!(preset.skin.is_polyconvex());
        }
    }
}
