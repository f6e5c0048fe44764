use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use prosopon_contract::{Check, WarningDocument, check_material};
use prosopon_contract::{D1ReadingName, Fault, MaterialDocument, PresetName};
use prosopon_tissue::fem::Preset;
use prosopon_tissue::fem::material::{EXPECTED_SHEAR, EXPECTED_STRETCH, Material, Materials, PathCheck, StandardTest};

/// Options for listing materials.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct MaterialsQuery {
    /// Meaning of the constant D1 in the preset `wang_2009`; `poisson_ratio` when absent.
    #[serde(default)]
    #[param(inline)]
    pub d1_reading: D1ReadingName,
}

/// Elastic moduli at small strain.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModuliView {
    /// Shear modulus, kPa.
    pub shear_modulus_kpa: f64,
    /// Bulk modulus K, kPa.
    pub bulk_modulus_kpa: f64,
    /// Young's modulus, kPa.
    pub young_modulus_kpa: f64,
    /// Poisson ratio, dimensionless.
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

/// Ranges `[smallest, largest]` of the expected stretch in which a material stays strongly elliptic.
///
/// Stretches are dimensionless, 1 at rest. `shear` is a range of the amount of shear, 0 at rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StableRangeView {
    /// Uniaxial: one axis is stretched, the other two contract equally.
    pub uniaxial: [f64; 2],
    /// Equibiaxial: two axes are stretched equally.
    pub equibiaxial: [f64; 2],
    /// Planar: one axis is stretched, one keeps its length.
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

/// A material with its moduli and its stable range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialView {
    /// Law and constants of the material.
    pub material: MaterialDocument,
    /// Moduli at small strain.
    pub moduli: ModuliView,
    /// Whether the energy is polyconvex and so stable at every stretch.
    pub polyconvex: bool,
    /// Ranges of stretch in which the material is stable.
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

/// A material preset: one material per tissue.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PresetView {
    /// Name of the preset, as a job's `preset` takes it.
    pub name: PresetName,
    /// Whether a job uses this preset if neither the job nor its session names one.
    pub default: bool,
    /// Source of the constants.
    pub source: String,
    /// Meaning of the published constant D1; present for `wang_2009` only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d1_reading: Option<D1ReadingName>,
    /// Materials by tissue: `skin`, `muscle`, `fat`, `mucosa` and `cartilage`.
    pub tissues: BTreeMap<String, MaterialView>,
}

/// A material law.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LawView {
    /// Name of the law, as a material's `law` takes it.
    pub name: String,
    /// Formula of the isochoric energy density, MPa.
    pub energy: String,
    /// Constants of the law by member name, with their units; an empty unit means dimensionless.
    pub constants: BTreeMap<String, String>,
}

/// Material laws and presets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialsList {
    /// Laws that a job can name.
    pub laws: Vec<LawView>,
    /// Formula of the default volumetric energy density, MPa.
    pub volumetric_energy: String,
    /// Material presets, the default first.
    pub presets: Vec<PresetView>,
    /// Smallest and largest stretch expected in tissue, dimensionless.
    pub expected_stretch: [f64; 2],
    /// Smallest and largest amount of shear expected in tissue, dimensionless.
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
    /// Lists all laws and presets. Analyses every material, which takes some milliseconds.
    #[must_use]
    pub fn new(d1: D1ReadingName) -> Self {
        let tissues = |m: &Materials| {
            let soft = [("skin", &m.skin), ("muscle", &m.muscle), ("fat", &m.fat), ("mucosa", &m.mucosa)];
            let all = soft.into_iter().chain([("cartilage", &m.cartilage)]);
            all.map(|(name, material)| (name.to_owned(), MaterialView::from(material))).collect()
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

/// Request for a stability check of one material.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckMaterial {
    /// Law and constants of the material to check.
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

/// A stability criterion that a material can violate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Sign of the stress: tensile in tension, compressive in compression.
    StressSign,
    /// The nominal stress increases with the stretch.
    RisingStress,
    /// Drucker stability at constant volume: stress and strain increments have a positive product.
    Drucker,
    /// Strong ellipticity: every acoustic tensor is positive definite.
    StrongEllipticity,
}

/// A standard deformation test at constant volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TestMode {
    /// Uniaxial: one axis is stretched, the other two contract equally.
    Uniaxial,
    /// Equibiaxial: two axes are stretched equally.
    Equibiaxial,
    /// Planar: one axis is stretched, one keeps its length.
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

/// The first violation of a criterion on a path from rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LossView {
    /// Criterion that is violated.
    pub criterion: Criterion,
    /// Test in which it is violated.
    pub mode: TestMode,
    /// Stretch (for `shear`: amount of shear) at which the violation starts, to 0.001.
    pub stretch: f64,
}

/// Result of one standard test at constant volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TestView {
    /// Test that was evaluated.
    pub mode: TestMode,
    /// Smallest and largest stretch (for `shear`: amount of shear) that was evaluated.
    pub looked_at: [f64; 2],
    /// Ranges of stretch (for `shear`: amount of shear) that violate a criterion, by its name.
    ///
    /// Criteria that hold throughout are absent.
    pub lost: BTreeMap<String, Vec<[f64; 2]>>,
}

/// Stability of a material in the standard tests.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaterialCheck {
    /// Law, constants, moduli and stable range.
    #[serde(flatten)]
    pub view: MaterialView,
    /// Whether all criteria hold at the expected stretches and shears.
    pub admissible: bool,
    /// First violation of each criterion in every test and both directions, the nearest to rest first.
    pub losses: Vec<LossView>,
    /// Results of the standard tests.
    pub tests: Vec<TestView>,
    /// Warning that a solve with this material will give; absent if it gives none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warning: Option<WarningDocument>,
}

fn criteria(check: &PathCheck) -> [(Criterion, &'static str, &Vec<[f64; 2]>); 4] {
    [
        (Criterion::StressSign, "stress_sign", &check.wrong_sign),
        (Criterion::RisingStress, "rising_stress", &check.falling_stress),
        (Criterion::Drucker, "drucker", &check.drucker_unstable),
        (Criterion::StrongEllipticity, "strong_ellipticity", &check.ellipticity_lost),
    ]
}

/// First violation of each criterion on both sides of rest.
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
    /// Evaluates the material in every test, which takes some ten milliseconds.
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
            warning: material.stability_warning("this tissue").map(Into::into),
        }
    }
}
