//! Drucker stability, ellipticity and sign of the stress along standard tests.

use super::energy::Material;
use super::principal::Principal;
use super::stable_range::StandardTest;
use nalgebra::{Matrix2, Matrix3, Vector3};

/// Range of stretches, and the step between samples.
const STRETCHES: [f64; 2] = [0.4, 2.0];
/// Range of shears, with the same step; negative shears are equivalent by symmetry.
const SHEARS: [f64; 2] = [0.0, 1.5];
const STEP: f64 = 1e-3;
/// Step of the central differences of the stress.
const DIFFERENCE: f64 = 1e-6;

/// Ranges of a standard test in which a material is unstable, each list ascending.
///
/// The samples are stretches from 0.4 to 2 in steps of 0.001, or shears from 0 to 1.5.
///
/// ```
/// use prosopon_tissue::fem::material::{Materials, StandardTest};
///
/// let published = Materials::wang2009().fat.check_path(StandardTest::Uniaxial);
/// assert!(!published.ellipticity_lost.is_empty());
/// assert!(Materials::wang2009_stable().fat.check_path(StandardTest::Uniaxial).is_clean());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PathCheck {
    /// The test.
    pub test: StandardTest,
    /// The material pulls when compressed or pushes when stretched.
    pub wrong_sign: Vec<[f64; 2]>,
    /// The nominal stress falls while the stretch rises.
    pub falling_stress: Vec<[f64; 2]>,
    /// Drucker stability is lost.
    ///
    /// The second variation of the energy by logarithmic strains at constant volume is not positive definite.
    pub drucker_unstable: Vec<[f64; 2]>,
    /// Strong ellipticity is lost.
    pub ellipticity_lost: Vec<[f64; 2]>,
}

impl PathCheck {
    /// Smallest and largest amount that is sampled.
    #[must_use]
    pub fn range(test: StandardTest) -> [f64; 2] {
        match test {
            StandardTest::Uniaxial | StandardTest::Equibiaxial | StandardTest::Planar => STRETCHES,
            StandardTest::Shear => SHEARS,
        }
    }

    /// Whether all lists are empty.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        [&self.wrong_sign, &self.falling_stress, &self.drucker_unstable, &self.ellipticity_lost]
            .iter()
            .all(|r| r.is_empty())
    }
}

impl Material {
    /// Samples `test` at constant volume; sides without a prescribed stretch are unloaded.
    #[must_use]
    pub fn check_path(&self, test: StandardTest) -> PathCheck {
        let [first, last] = PathCheck::range(test);
        let n = ((last - first) / STEP).round() as usize;
        let stretches: Vec<f64> = (0..=n).map(|i| first + STEP * i as f64).collect();
        let ranges = |bad: &dyn Fn(f64) -> bool| {
            let marks: Vec<bool> = stretches.iter().map(|l| bad(*l)).collect();
            let both: Vec<(f64, bool)> = stretches.iter().copied().zip(marks).collect();
            let runs = both.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1);
            runs.map(|run| [run[0].0, run[run.len() - 1].0]).collect::<Vec<_>>()
        };
        let noise = 1e-9 * self.shear_modulus().abs();
        let rise = |l: f64| self.driving_stress(test, l + DIFFERENCE) - self.driving_stress(test, l - DIFFERENCE);
        PathCheck {
            test,
            wrong_sign: ranges(&|l| {
                let from_rest = l - test.rest();
                self.driving_stress(test, l) * from_rest.signum() < -noise && from_rest.abs() > 0.5 * STEP
            }),
            falling_stress: ranges(&|l| rise(l) < 0.0),
            drucker_unstable: ranges(&|l| !self.is_drucker_stable(&Principal::of(&test.deformation(l)).stretches)),
            ellipticity_lost: ranges(&|l| !self.is_elliptic(&test.deformation(l))),
        }
    }

    /// Nominal stress along the first axis with the third free, MPa (the pressure that keeps the volume is eliminated); in shear,
    /// the shear stress.
    fn driving_stress(&self, test: StandardTest, amount: f64) -> f64 {
        let f: Matrix3<f64> = test.deformation(amount);
        let Ok(p) = self.isochoric_part().first_piola(&f) else { return f64::NAN };
        match test {
            StandardTest::Uniaxial | StandardTest::Equibiaxial | StandardTest::Planar => {
                p[(0, 0)] - p[(2, 2)] * f[(2, 2)] / f[(0, 0)]
            }
            StandardTest::Shear => p[(0, 1)],
        }
    }

    /// Drucker stability: `d²W` by two logarithmic strains, with the third determined by constant volume, is positive definite.
    fn is_drucker_stable(&self, s: &Vector3<f64>) -> bool {
        let isochoric = self.isochoric_part();
        let (Ok(h), Ok(p)) = (isochoric.principal_hessian(s), isochoric.first_piola(&Matrix3::from_diagonal(s))) else {
            return false;
        };
        let w = |i: usize, j: usize| s[i] * s[j] * h.scaling[(i, j)] + if i == j { s[i] * p[(i, i)] } else { 0.0 };
        let entry = |i: usize, j: usize| w(i, j) - w(i, 2) - w(j, 2) + w(2, 2);
        let hessian = Matrix2::new(entry(0, 0), entry(0, 1), entry(0, 1), entry(1, 1));
        hessian[(0, 0)] > 0.0 && hessian.determinant() > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::Materials;

    fn near(found: &[[f64; 2]], expected: &[[f64; 2]]) {
        assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
        for (f, e) in found.iter().flatten().zip(expected.iter().flatten()) {
            // The table has four digits, and the samples are 1e-3 apart.
            assert!((f - e).abs() < 1.2e-3, "{found:?} {expected:?}");
        }
    }

    /// Against a table computed by another program from the incompressible closed forms.
    #[test]
    fn published_constants_misbehave_as_in_an_independent_table() {
        let m = Materials::wang2009();
        let rest = |high: f64| vec![[high, 2.0]];
        for (material, test, wrong, falling, drucker, lost) in [
            (
                m.skin,
                StandardTest::Uniaxial,
                vec![[0.4, 0.8116]],
                vec![[0.4, 0.8956]],
                [0.9005, 1.1101],
                [0.8116, 1.1101],
            ),
            (m.skin, StandardTest::Equibiaxial, rest(1.1101), rest(1.0524), [0.9491, 1.0538], [0.9491, 1.1101]),
            (m.skin, StandardTest::Planar, vec![], vec![], [0.9134, 1.0948], [0.9008, 1.1101]),
            (
                m.muscle,
                StandardTest::Uniaxial,
                vec![[0.4, 0.7864]],
                vec![[0.4, 0.8799]],
                [0.8863, 1.1276],
                [0.7864, 1.1276],
            ),
            (m.muscle, StandardTest::Equibiaxial, rest(1.1276), rest(1.0603), [0.9417, 1.0622], [0.9417, 1.1276]),
            (
                m.fat,
                StandardTest::Uniaxial,
                vec![[0.4, 0.9638]],
                vec![[0.4, 0.9815]],
                [0.9817, 1.0186],
                [0.9638, 1.0186],
            ),
            (m.fat, StandardTest::Planar, vec![], vec![], [0.9841, 1.0161], [0.9817, 1.0186]),
        ] {
            let check = Material { bulk: 1e4 * material.bulk, ..material }.check_path(test);
            near(&check.wrong_sign, &wrong);
            near(&check.falling_stress, &falling);
            near(&check.drucker_unstable, &[[0.4, drucker[0]], [drucker[1], 2.0]]);
            near(&check.ellipticity_lost, &[[0.4, lost[0]], [lost[1], 2.0]]);
        }
    }

    /// Simple shear by l - 1/l is a planar stretch l, rotated; the shear stress of Mooney-Rivlin is mu times the shear.
    #[test]
    fn shear_loses_ellipticity_where_planar_stretch_does_and_keeps_its_sign() {
        let m = Materials::wang2009();
        for (material, planar) in [(m.skin, 1.1101f64), (m.muscle, 1.1276), (m.fat, 1.0186)] {
            let check = Material { bulk: 1e4 * material.bulk, ..material }.check_path(StandardTest::Shear);
            near(&check.ellipticity_lost, &[[planar - 1.0 / planar, 1.5]]);
            near(&check.wrong_sign, &[]);
            near(&check.falling_stress, &[]);
        }
        // A shear stress with a maximum: Yeoh with a negative second constant, mu g (1 + 2 c2 / c1 g²), highest at g = sqrt(-c1 /
        // (6 c2)).
        let check = Material::yeoh([0.02, -0.02, 0.0], 0.45).check_path(StandardTest::Shear);
        near(&check.falling_stress, &[[(1.0f64 / 6.0).sqrt(), 1.5]]);
        near(&check.wrong_sign, &[[0.5f64.sqrt(), 1.5]]);
    }

    #[test]
    fn stable_presets_are_clean() {
        for m in [Materials::wang2009_stable(), Materials::wang2009_tension()] {
            for material in [m.skin, m.muscle, m.fat] {
                for test in StandardTest::ALL {
                    let check = material.check_path(test);
                    assert!(check.is_clean(), "{check:?}");
                }
            }
        }
    }
}
