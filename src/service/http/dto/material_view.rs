use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::check::Check;
use super::material::check_material;
use prosopon_session::{D1ReadingName, Fault, MaterialDocument, PresetName};
use prosopon_tissue::fem::Preset;
use prosopon_tissue::fem::material::{EXPECTED_SHEAR, EXPECTED_STRETCH, Material, Materials, PathCheck, StandardTest};

/// How materials are to be listed.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct MaterialsQuery {
    /// Meaning of D1 in the preset `wang_2009`; `poisson_ratio` when absent.
    #[serde(default)]
    #[param(inline)]
    pub d1_reading: D1ReadingName,
}

/// Moduli at small strain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModuliView {
    /// Shear modulus, kPa.
    pub shear_modulus_kpa: f64,
    /// Bulk modulus K, kPa.
    pub bulk_modulus_kpa: f64,
    /// Young's modulus, kPa.
    pub young_modulus_kpa: f64,
    /// Poisson ratio.
    pub poisson: f64,
}

impl From<&Material> for ModuliView {
    fn from(material: &Material) -> Self {
        let (shear, poisson) = (material.shear_modulus(), material.poisson_ratio());
        Self {
            shear_modulus_kpa: 1e3 * shear,
            bulk_modulus_kpa: 1e3 * material.bulk,
            young_modulus_kpa: 2e3 * shear * (1.0 + poisson),
            poisson,
        }
    }
}

/// Stretches from smallest to largest (of `shear`: shears), within the expected ones, between which a material stays strongly elliptic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StableRangeView {
    /// One axis stretched, the others alike.
    pub uniaxial: [f64; 2],
    /// Two axes stretched alike.
    pub equibiaxial: [f64; 2],
    /// One axis stretched, one kept.
    pub planar: [f64; 2],
    /// Simple shear.
    pub shear: [f64; 2],
}

impl From<&Material> for StableRangeView {
    fn from(material: &Material) -> Self {
        Self {
            uniaxial: material.elliptic_range(StandardTest::Uniaxial),
            equibiaxial: material.elliptic_range(StandardTest::Equibiaxial),
            planar: material.elliptic_range(StandardTest::Planar),
            shear: material.elliptic_range(StandardTest::Shear),
        }
    }
}

/// A material and what it is like.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialView {
    /// Law and constants.
    pub material: MaterialDocument,
    /// Moduli at small strain.
    pub moduli: ModuliView,
    /// Whether the energy is polyconvex, and so stable at every stretch.
    pub polyconvex: bool,
    /// Where it is stable.
    pub stable_range: StableRangeView,
}

impl From<&Material> for MaterialView {
    fn from(material: &Material) -> Self {
        Self {
            material: material.into(),
            moduli: material.into(),
            polyconvex: material.is_polyconvex(),
            stable_range: material.into(),
        }
    }
}

/// A preset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PresetView {
    /// Its name in a job's `preset`.
    pub name: PresetName,
    /// Whether it is taken where a job and its session name none.
    pub default: bool,
    /// Where its constants come from.
    pub source: String,
    /// Meaning of D1, of the published constants.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d1_reading: Option<D1ReadingName>,
    /// Materials of `skin`, `muscle`, `fat`, `mucosa`.
    pub tissues: BTreeMap<String, MaterialView>,
}

/// A law.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LawView {
    /// Its name in `law`.
    pub name: String,
    /// Isochoric energy density, MPa.
    pub energy: String,
    /// Members that it takes, with their units (empty: none).
    pub constants: BTreeMap<String, String>,
}

/// Presets and laws.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialsList {
    /// Laws that a job may name.
    pub laws: Vec<LawView>,
    /// Volumetric energy density of every law, MPa.
    pub volumetric_energy: String,
    /// Presets, the default first.
    pub presets: Vec<PresetView>,
    /// Stretches that tissue is expected to meet.
    pub expected_stretch: [f64; 2],
    /// Shears that tissue is expected to meet.
    pub expected_shear: [f64; 2],
}

const VOLUMETRIC: &str = "K/4 (J² - 1 - 2 ln J), K = 2 mu (1 + nu) / (3 (1 - 2 nu))";

fn laws() -> Vec<LawView> {
    let law = |name: &str, energy: &str, constants: &[&str]| LawView {
        name: name.to_owned(),
        energy: energy.to_owned(),
        constants: constants
            .iter()
            .chain(&["poisson"])
            .map(|c| ((*c).to_owned(), if c.ends_with("_mpa") { "MPa" } else { "" }.to_owned()))
            .collect(),
    };
    vec![
        law("neo_hookean", "mu/2 (J^(-2/3) I1 - 3)", &["shear_modulus_mpa"]),
        law("mooney_rivlin", "c10 (J^(-2/3) I1 - 3) + c01 (J^(-4/3) I2 - 3)", &["c10_mpa", "c01_mpa"]),
        law("yeoh", "c1 f + c2 f² + c3 f³, f = J^(-2/3) I1 - 3", &["c1_mpa", "c2_mpa", "c3_mpa"]),
        law(
            "ogden",
            "2 mu / alpha² (J^(-alpha/3) (s1^alpha + s2^alpha + s3^alpha) - 3), s the principal stretches",
            &["shear_modulus_mpa", "alpha"],
        ),
    ]
}

impl MaterialsList {
    /// Everything there is. Analyses every material: some milliseconds.
    #[must_use]
    pub fn new(d1: D1ReadingName) -> Self {
        let tissues = |m: &Materials| {
            let all = [("skin", &m.skin), ("muscle", &m.muscle), ("fat", &m.fat), ("mucosa", &m.mucosa)];
            all.into_iter().map(|(name, material)| (name.to_owned(), MaterialView::from(material))).collect()
        };
        let preset = |name: PresetName| PresetView {
            name,
            default: name == PresetName::default(),
            source: Preset::from(name).source().to_owned(),
            d1_reading: (name == PresetName::Wang2009).then_some(d1),
            tissues: tissues(&name.materials(d1)),
        };
        Self {
            laws: laws(),
            volumetric_energy: VOLUMETRIC.to_owned(),
            presets: PresetName::ALL.map(preset).into(),
            expected_stretch: EXPECTED_STRETCH,
            expected_shear: EXPECTED_SHEAR,
        }
    }
}

/// A material to analyse.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckMaterial {
    /// Law and constants.
    pub material: MaterialDocument,
}

impl CheckMaterial {
    pub(in crate::http) fn check(&self) -> Result<Material, Fault> {
        let mut check = Check::default();
        let material = check_material(&mut check, "/material", &self.material);
        check.finish()?;
        Ok(material)
    }
}

/// What a material may lose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Stress pulls where the material is stretched and pushes where it is compressed.
    StressSign,
    /// The nominal stress rises with the stretch.
    RisingStress,
    /// Drucker: stress and strain increments agree in direction at constant volume.
    Drucker,
    /// Strong ellipticity: every acoustic tensor is positive definite.
    StrongEllipticity,
}

/// A standard test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TestMode {
    /// One axis stretched, the others alike.
    Uniaxial,
    /// Two axes stretched alike.
    Equibiaxial,
    /// One axis stretched, one kept.
    Planar,
    /// Simple shear.
    Shear,
}

impl From<StandardTest> for TestMode {
    fn from(test: StandardTest) -> Self {
        match test {
            StandardTest::Uniaxial => Self::Uniaxial,
            StandardTest::Equibiaxial => Self::Equibiaxial,
            StandardTest::Planar => Self::Planar,
            StandardTest::Shear => Self::Shear,
        }
    }
}

/// Where a criterion is lost first on the way from rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LossView {
    /// What is lost.
    pub criterion: Criterion,
    /// In which test.
    pub mode: TestMode,
    /// At which stretch (of `shear`: shear), to 0.001.
    pub stretch: f64,
}

/// One standard test at constant volume; ranges of stretch (of `shear`: shear) in which a criterion does not hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TestView {
    /// The test.
    pub mode: TestMode,
    /// Smallest and largest stretch that was looked at.
    pub looked_at: [f64; 2],
    /// Ranges without the criterion, by its name; absent where it holds throughout.
    pub lost: BTreeMap<String, Vec<[f64; 2]>>,
}

/// What a material is like in the standard tests.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialCheck {
    /// Law, constants, moduli, stable range.
    #[serde(flatten)]
    pub view: MaterialView,
    /// Whether no criterion is lost at the expected stretches and shears.
    pub admissible: bool,
    /// What is lost first, in every test and both directions, the nearest to rest first.
    pub losses: Vec<LossView>,
    /// The tests.
    pub tests: Vec<TestView>,
    /// What a solve will warn of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
}

fn criteria(check: &PathCheck) -> [(Criterion, &'static str, &Vec<[f64; 2]>); 4] {
    [
        (Criterion::StressSign, "stress_sign", &check.wrong_sign),
        (Criterion::RisingStress, "rising_stress", &check.falling_stress),
        (Criterion::Drucker, "drucker", &check.drucker_unstable),
        (Criterion::StrongEllipticity, "strong_ellipticity", &check.ellipticity_lost),
    ]
}

/// First losses on both sides of rest.
fn first_losses(check: &PathCheck) -> Vec<LossView> {
    let rest = check.test.rest();
    let mut losses = Vec::new();
    for (criterion, _, ranges) in criteria(check) {
        let below = ranges.iter().map(|r| r[1]).filter(|end| *end < rest).reduce(f64::max);
        let above = ranges.iter().map(|r| r[0]).filter(|start| *start > rest).reduce(f64::min);
        let at_rest = ranges.iter().any(|r| (r[0]..=r[1]).contains(&rest)).then_some(rest);
        let found = at_rest.map_or([below, above], |rest| [Some(rest), None]);
        let mode = check.test.into();
        losses.extend(found.into_iter().flatten().map(|stretch| LossView { criterion, mode, stretch }));
    }
    losses
}

impl MaterialCheck {
    /// Takes the material through every test; some ten milliseconds.
    #[must_use]
    pub fn new(material: &Material) -> Self {
        let checks = StandardTest::ALL.map(|test| material.check_path(test));
        let in_expected = |check: &PathCheck, range: &[f64; 2]| {
            let [low, high] = check.test.expected();
            range[1] >= low && range[0] <= high
        };
        let admissible = checks
            .iter()
            .all(|c| criteria(c).iter().all(|(_, _, ranges)| !ranges.iter().any(|range| in_expected(c, range))));
        let distance = |loss: &LossView| match loss.mode {
            TestMode::Uniaxial | TestMode::Equibiaxial | TestMode::Planar => loss.stretch.ln().abs(),
            TestMode::Shear => loss.stretch.abs(),
        };
        let mut losses: Vec<LossView> = checks.iter().flat_map(first_losses).collect();
        losses.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let test = |check: &PathCheck| TestView {
            mode: check.test.into(),
            looked_at: PathCheck::range(check.test),
            lost: criteria(check)
                .into_iter()
                .filter(|(_, _, ranges)| !ranges.is_empty())
                .map(|(_, name, ranges)| (name.to_owned(), ranges.clone()))
                .collect(),
        };
        Self {
            view: material.into(),
            admissible,
            losses,
            tests: checks.iter().map(test).collect(),
            warning: material.stability_warning("this tissue"),
        }
    }
}
