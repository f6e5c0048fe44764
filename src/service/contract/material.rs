use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use prosopon_tissue::fem::material::{D1Reading, Isochoric, Material, Materials, Volumetric};
use prosopon_tissue::fem::{Locking, Preset, SkinElement, UnstableMaterial};
use prosopon_tissue::mesh::Tissue;

/// Volumetric energy of the volume ratio J; its bulk modulus K gives the Poisson ratio at rest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VolumetricName {
    /// `K/4 (J² - 1 - 2 ln J)`, which resists collapse.
    #[default]
    Logarithmic,
    /// `K/2 (J - 1)²`, finite at J = 0: tissue collapses under large pressure.
    Quadratic,
}

impl VolumetricName {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl From<VolumetricName> for Volumetric {
    fn from(name: VolumetricName) -> Self {
        match name {
            VolumetricName::Logarithmic => Self::Logarithmic,
            VolumetricName::Quadratic => Self::Quadratic,
        }
    }
}

impl From<Volumetric> for VolumetricName {
    fn from(volumetric: Volumetric) -> Self {
        match volumetric {
            Volumetric::Logarithmic => Self::Logarithmic,
            Volumetric::Quadratic => Self::Quadratic,
        }
    }
}

/// A compressible material: an isochoric law of the deviatoric stretches and a volumetric energy.
///
/// The bulk modulus K of the volumetric energy gives the Poisson ratio at rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "law", rename_all = "snake_case", try_from = "MaterialMembers")]
pub enum MaterialDocument {
    /// `c10 (J^(-2/3) I1 - 3) + c01 (J^(-4/3) I2 - 3)`.
    MooneyRivlin {
        /// C10, MPa.
        c10_mpa: f64,
        /// C01, MPa.
        c01_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
        /// Volumetric energy; `logarithmic` when absent.
        #[serde(default, skip_serializing_if = "VolumetricName::is_default")]
        volumetric: VolumetricName,
    },
    /// `mu/2 (J^(-2/3) I1 - 3)`.
    NeoHookean {
        /// Shear modulus mu, MPa.
        shear_modulus_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
        /// Volumetric energy; `logarithmic` when absent.
        #[serde(default, skip_serializing_if = "VolumetricName::is_default")]
        volumetric: VolumetricName,
    },
    /// `c1 f + c2 f² + c3 f³` with `f = J^(-2/3) I1 - 3`.
    Yeoh {
        /// C1, MPa.
        c1_mpa: f64,
        /// C2, MPa; 0 when absent.
        #[serde(default)]
        c2_mpa: f64,
        /// C3, MPa; 0 when absent.
        #[serde(default)]
        c3_mpa: f64,
        /// Poisson ratio at rest.
        poisson: f64,
        /// Volumetric energy; `logarithmic` when absent.
        #[serde(default, skip_serializing_if = "VolumetricName::is_default")]
        volumetric: VolumetricName,
    },
    /// `2 mu / alpha² (J^(-alpha/3) (s1^alpha + s2^alpha + s3^alpha) - 3)` of the principal stretches.
    Ogden {
        /// Shear modulus mu at rest, MPa.
        shear_modulus_mpa: f64,
        /// Exponent, not 0.
        alpha: f64,
        /// Poisson ratio at rest.
        poisson: f64,
        /// Volumetric energy; `logarithmic` when absent.
        #[serde(default, skip_serializing_if = "VolumetricName::is_default")]
        volumetric: VolumetricName,
    },
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum LawName {
    MooneyRivlin,
    NeoHookean,
    Yeoh,
    Ogden,
}

/// Members of all laws in one structure.
///
/// Errors then keep their path in the document, and a list is refused.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialMembers {
    law: LawName,
    poisson: f64,
    #[serde(default)]
    volumetric: VolumetricName,
    #[serde(default)]
    c10_mpa: Option<f64>,
    #[serde(default)]
    c01_mpa: Option<f64>,
    #[serde(default)]
    shear_modulus_mpa: Option<f64>,
    #[serde(default)]
    c1_mpa: Option<f64>,
    #[serde(default)]
    c2_mpa: Option<f64>,
    #[serde(default)]
    c3_mpa: Option<f64>,
    #[serde(default)]
    alpha: Option<f64>,
}

impl TryFrom<MaterialMembers> for MaterialDocument {
    type Error = String;

    fn try_from(m: MaterialMembers) -> Result<Self, String> {
        let all = [
            ("c10_mpa", m.c10_mpa),
            ("c01_mpa", m.c01_mpa),
            ("shear_modulus_mpa", m.shear_modulus_mpa),
            ("c1_mpa", m.c1_mpa),
            ("c2_mpa", m.c2_mpa),
            ("c3_mpa", m.c3_mpa),
            ("alpha", m.alpha),
        ];
        let (law, needed, optional): (_, &[&str], &[&str]) = match m.law {
            LawName::MooneyRivlin => ("mooney_rivlin", &["c10_mpa", "c01_mpa"], &[]),
            LawName::NeoHookean => ("neo_hookean", &["shear_modulus_mpa"], &[]),
            LawName::Yeoh => ("yeoh", &["c1_mpa"], &["c2_mpa", "c3_mpa"]),
            LawName::Ogden => ("ogden", &["shear_modulus_mpa", "alpha"], &[]),
        };
        for (name, value) in all {
            if needed.contains(&name) && value.is_none() {
                return Err(format!("{law} needs {name}"));
            }
            if value.is_some() && !needed.contains(&name) && !optional.contains(&name) {
                return Err(format!("{name} is no constant of {law}"));
            }
        }
        let (number, poisson, volumetric) = (Option::unwrap_or_default, m.poisson, m.volumetric);
        Ok(match m.law {
            LawName::MooneyRivlin => {
                Self::MooneyRivlin { c10_mpa: number(m.c10_mpa), c01_mpa: number(m.c01_mpa), poisson, volumetric }
            }
            LawName::NeoHookean => {
                Self::NeoHookean { shear_modulus_mpa: number(m.shear_modulus_mpa), poisson, volumetric }
            }
            LawName::Yeoh => Self::Yeoh {
                c1_mpa: number(m.c1_mpa),
                c2_mpa: number(m.c2_mpa),
                c3_mpa: number(m.c3_mpa),
                poisson,
                volumetric,
            },
            LawName::Ogden => Self::Ogden {
                shear_modulus_mpa: number(m.shear_modulus_mpa),
                alpha: number(m.alpha),
                poisson,
                volumetric,
            },
        })
    }
}

impl From<&MaterialDocument> for Material {
    /// Takes the constants unchanged: requests are checked before.
    fn from(document: &MaterialDocument) -> Self {
        let (material, volumetric) = match *document {
            MaterialDocument::MooneyRivlin { c10_mpa, c01_mpa, poisson, volumetric } => {
                (Self::mooney_rivlin(c10_mpa, c01_mpa, poisson), volumetric)
            }
            MaterialDocument::NeoHookean { shear_modulus_mpa, poisson, volumetric } => {
                (Self::neo_hookean(shear_modulus_mpa, poisson), volumetric)
            }
            MaterialDocument::Yeoh { c1_mpa, c2_mpa, c3_mpa, poisson, volumetric } => {
                (Self::yeoh([c1_mpa, c2_mpa, c3_mpa], poisson), volumetric)
            }
            MaterialDocument::Ogden { shear_modulus_mpa, alpha, poisson, volumetric } => {
                (Self::ogden(shear_modulus_mpa, alpha, poisson), volumetric)
            }
        };
        material.with_volumetric(volumetric.into())
    }
}

impl From<&Material> for MaterialDocument {
    fn from(material: &Material) -> Self {
        let (poisson, volumetric) = (material.poisson_ratio(), material.volumetric.into());
        match material.isochoric {
            Isochoric::MooneyRivlin { c10, c01: 0.0 } => {
                Self::NeoHookean { shear_modulus_mpa: 2.0 * c10, poisson, volumetric }
            }
            Isochoric::MooneyRivlin { c10, c01 } => {
                Self::MooneyRivlin { c10_mpa: c10, c01_mpa: c01, poisson, volumetric }
            }
            Isochoric::Yeoh { c1, c2, c3 } => Self::Yeoh { c1_mpa: c1, c2_mpa: c2, c3_mpa: c3, poisson, volumetric },
            Isochoric::Ogden { mu, alpha } => Self::Ogden { shear_modulus_mpa: mu, alpha, poisson, volumetric },
        }
    }
}

/// Material laws by tissue; a tissue without one keeps that of the preset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueLawsDocument {
    /// Law of the skin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skin: Option<MaterialDocument>,
    /// Law of muscle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub muscle: Option<MaterialDocument>,
    /// Law of fat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fat: Option<MaterialDocument>,
    /// Law of mucosa.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mucosa: Option<MaterialDocument>,
    /// Law of cartilage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cartilage: Option<MaterialDocument>,
}

impl TissueLawsDocument {
    /// Every tissue by name, with its law if one is given.
    #[must_use]
    pub fn all(&self) -> [(&'static str, Tissue, Option<&MaterialDocument>); 5] {
        [
            ("skin", Tissue::Skin, self.skin.as_ref()),
            ("muscle", Tissue::Muscle, self.muscle.as_ref()),
            ("fat", Tissue::Fat, self.fat.as_ref()),
            ("mucosa", Tissue::Mucosa, self.mucosa.as_ref()),
            ("cartilage", Tissue::Cartilage, self.cartilage.as_ref()),
        ]
    }

    /// The given laws by tissue.
    #[must_use]
    pub fn given(&self) -> Vec<(&'static str, Tissue, &MaterialDocument)> {
        self.all().into_iter().filter_map(|(name, tissue, law)| Some((name, tissue, law?))).collect()
    }

    /// `materials` with the given laws in place of its own.
    #[must_use]
    pub fn over(&self, mut materials: Materials) -> Materials {
        for (_, tissue, law) in self.given() {
            materials.set(tissue, law.into());
        }
        materials
    }
}

/// Material preset: laws of all tissues.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum PresetName {
    /// Stable neo-Hookean with the published small-strain moduli.
    #[default]
    #[serde(rename = "wang_2009_stable")]
    Wang2009Stable,
    /// Stable Yeoh that follows the published curve in tension.
    #[serde(rename = "wang_2009_tension")]
    Wang2009Tension,
    /// The published constants, which lose ellipticity early.
    #[serde(rename = "wang_2009")]
    Wang2009,
    /// Yeoh fitted to indentation of a cheek, one material for all tissues.
    #[serde(rename = "nazari_2010")]
    Nazari2010,
    /// Small-strain moduli of passive facial tissue, one material for all tissues.
    #[serde(rename = "chabanas_2003")]
    Chabanas2003,
}

impl PresetName {
    /// Every preset, the default first.
    pub const ALL: [Self; 5] =
        [Self::Wang2009Stable, Self::Wang2009Tension, Self::Wang2009, Self::Nazari2010, Self::Chabanas2003];

    /// Materials of the preset; `d1` applies to `wang_2009` only.
    #[must_use]
    pub fn materials(self, d1: D1ReadingName) -> Materials {
        match self {
            Self::Wang2009 => Materials::wang2009_reading(d1.into()),
            Self::Wang2009Stable | Self::Wang2009Tension | Self::Nazari2010 | Self::Chabanas2003 => {
                Preset::from(self).materials()
            }
        }
    }
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Self {
        match name {
            PresetName::Wang2009Stable => Self::Wang2009Stable,
            PresetName::Wang2009Tension => Self::Wang2009Tension,
            PresetName::Wang2009 => Self::Wang2009,
            PresetName::Nazari2010 => Self::Nazari2010,
            PresetName::Chabanas2003 => Self::Chabanas2003,
        }
    }
}

/// Reading of `D1` in Wang 2009, Table 1, which the paper does not define.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum D1ReadingName {
    /// The Poisson ratio: 0.49, 0.30, 0.49 of skin, muscle, fat.
    #[default]
    PoissonRatio,
    /// `2/K` in 1/MPa: Poisson ratios 0.4915, 0.4969, 0.4986.
    PerMpa,
    /// `2/K` in mm²/gf, the unit of the other constants: Poisson ratios -0.053, 0.240, 0.366.
    Mm2PerGf,
}

impl From<D1ReadingName> for D1Reading {
    fn from(name: D1ReadingName) -> Self {
        match name {
            D1ReadingName::PoissonRatio => Self::PoissonRatio,
            D1ReadingName::PerMpa => Self::PerMpa,
            D1ReadingName::Mm2PerGf => Self::Mm2PerGf,
        }
    }
}

/// Element of the skin layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SkinElementName {
    /// Three linear tetrahedra for each prism.
    Tet,
    /// Linear wedge.
    Wedge,
    /// Prism with a C1 outer surface.
    C1Prism,
}

impl From<SkinElement> for SkinElementName {
    fn from(element: SkinElement) -> Self {
        match element {
            SkinElement::Tetrahedron => Self::Tet,
            SkinElement::Wedge => Self::Wedge,
            SkinElement::C1Prism => Self::C1Prism,
        }
    }
}

impl From<SkinElementName> for SkinElement {
    fn from(name: SkinElementName) -> Self {
        match name {
            SkinElementName::Tet => Self::Tetrahedron,
            SkinElementName::Wedge => Self::Wedge,
            SkinElementName::C1Prism => Self::C1Prism,
        }
    }
}

/// Locking-free formulation of linear tetrahedra.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LockingName {
    /// None: plain linear tetrahedra.
    None,
    /// Isochoric energy at strains averaged over edges, volumetric energy at strains averaged over nodes.
    Smoothed,
    /// Volumetric and most of the isochoric energy at strains averaged over patches of about eight tetrahedra.
    Patched,
}

impl LockingName {
    /// Name on the wire.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Smoothed => "smoothed",
            Self::Patched => "patched",
        }
    }
}

impl From<LockingName> for Locking {
    fn from(name: LockingName) -> Self {
        match name {
            LockingName::None => Self::None,
            LockingName::Smoothed => Self::Smoothed,
            LockingName::Patched => Self::Patched,
        }
    }
}

impl From<Locking> for LockingName {
    fn from(locking: Locking) -> Self {
        match locking {
            Locking::None => Self::None,
            Locking::Smoothed => Self::Smoothed,
            Locking::Patched => Self::Patched,
        }
    }
}

/// What the solver does when a material loses ellipticity.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UnstableMaterialName {
    /// Report it in the step's outcome; the path ends when no equilibrium is found.
    #[default]
    Report,
    /// Replace the material from there on by neo-Hookean with the same small-strain moduli.
    Stabilise,
}

impl From<UnstableMaterialName> for UnstableMaterial {
    fn from(name: UnstableMaterialName) -> Self {
        match name {
            UnstableMaterialName::Report => Self::Report,
            UnstableMaterialName::Stabilise => Self::Stabilise,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laws_come_back_and_faults_are_told() {
        for text in [
            r#"{"law":"mooney_rivlin","c10_mpa":0.004,"c01_mpa":0.001,"poisson":0.45}"#,
            r#"{"law":"neo_hookean","shear_modulus_mpa":0.07,"poisson":0.49}"#,
            r#"{"law":"yeoh","c1_mpa":0.0025,"c2_mpa":0.001175,"c3_mpa":0.0,"poisson":0.49}"#,
            r#"{"law":"ogden","shear_modulus_mpa":0.4,"alpha":12.0,"poisson":0.49}"#,
        ] {
            let document: MaterialDocument = serde_json::from_str(text).unwrap();
            assert_eq!(serde_json::to_string(&document).unwrap(), text);
            let material = Material::from(&document);
            let back = Material::from(&MaterialDocument::from(&material));
            assert_eq!(back.isochoric, material.isochoric);
            assert!((back.bulk - material.bulk).abs() < 1e-9 * material.bulk);
        }
        for (text, expected) in [
            (r#"{"law":"yeoh","poisson":0.4}"#, "yeoh needs c1_mpa"),
            (r#"{"law":"ogden","shear_modulus_mpa":1,"c1_mpa":1,"alpha":2,"poisson":0.4}"#, "no constant of ogden"),
            (r#"{"law":"hooke","poisson":0.4}"#, "hooke"),
            (r#"{"law":"neo_hookean","shear_modulus_mpa":1}"#, "poisson"),
            (r#"{"law":"neo_hookean","shear_modulus_mpa":1,"poisson":0.4,"x":1}"#, "`x`"),
        ] {
            let error = serde_json::from_str::<MaterialDocument>(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
