//! Ranges of standard tests in which a material is strongly elliptic.

use super::energy::Material;
use nalgebra::{Matrix3, Vector3};
use prosopon_geometry::Warning;

/// Range of stretches in which materials are checked: from half the length to twice.
pub const EXPECTED_STRETCH: [f64; 2] = [0.5, 2.0];
/// Range of shears in which materials are checked: their largest principal stretch is 2.
pub const EXPECTED_SHEAR: [f64; 2] = [-1.5, 1.5];

/// A standard test at constant volume, which soft tissue nearly keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StandardTest {
    /// Stretch along one axis, the other two axes contract equally.
    Uniaxial,
    /// The same stretch along two axes.
    Equibiaxial,
    /// Stretch along one axis, none along the second.
    Planar,
    /// Simple shear; the amount is the shear instead of a stretch.
    Shear,
}

impl StandardTest {
    /// All tests.
    pub const ALL: [Self; 4] = [Self::Uniaxial, Self::Equibiaxial, Self::Planar, Self::Shear];

    /// Name of the test in messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniaxial => "uniaxial",
            Self::Equibiaxial => "equibiaxial",
            Self::Planar => "planar",
            Self::Shear => "shear",
        }
    }

    /// Amount at rest: 1 for a stretch, 0 for a shear.
    #[must_use]
    pub fn rest(self) -> f64 {
        match self {
            Self::Uniaxial | Self::Equibiaxial | Self::Planar => 1.0,
            Self::Shear => 0.0,
        }
    }

    /// Smallest and largest amount expected in tissue.
    #[must_use]
    pub fn expected(self) -> [f64; 2] {
        match self {
            Self::Uniaxial | Self::Equibiaxial | Self::Planar => EXPECTED_STRETCH,
            Self::Shear => EXPECTED_SHEAR,
        }
    }

    /// Deformation gradient at `amount`, a stretch or a shear.
    #[must_use]
    pub fn deformation(self, amount: f64) -> Matrix3<f64> {
        let l = amount;
        Matrix3::from_diagonal(&match self {
            Self::Uniaxial => Vector3::new(l, l.powf(-0.5), l.powf(-0.5)),
            Self::Equibiaxial => Vector3::new(l, l, l.powi(-2)),
            Self::Planar => Vector3::new(l, 1.0, 1.0 / l),
            Self::Shear => return Matrix3::new(1.0, l, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        })
    }
}

impl Material {
    /// Smallest and largest amount of `test` up to which the material stays strongly elliptic from rest on.
    ///
    /// The search is limited to [`StandardTest::expected`] and accurate to 1e-4.
    ///
    /// ```
    /// use prosopon_tissue::fem::material::{EXPECTED_STRETCH, Materials, StandardTest};
    ///
    /// // The published constants of fat lose ellipticity below a stretch of 1.02, the stable ones nowhere.
    /// let [_, high] = Materials::wang2009().fat.elliptic_range(StandardTest::Uniaxial);
    /// assert!(high < 1.02);
    /// let stable = Materials::wang2009_stable().fat;
    /// assert_eq!(stable.elliptic_range(StandardTest::Uniaxial), EXPECTED_STRETCH);
    /// ```
    #[must_use]
    pub fn elliptic_range(&self, test: StandardTest) -> [f64; 2] {
        test.expected().map(|end| {
            // A hundred steps (logarithmic for stretches) bracket the limit, then bisection.
            let (at, length): (&dyn Fn(f64) -> f64, f64) = match test {
                StandardTest::Uniaxial | StandardTest::Equibiaxial | StandardTest::Planar => {
                    (&|share: f64| end.powf(share), end.ln().abs())
                }
                StandardTest::Shear => (&|share: f64| end * share, end.abs()),
            };
            let holds = |share: f64| self.is_elliptic(&test.deformation(at(share)));
            if !holds(0.0) {
                return test.rest();
            }
            let Some(lost) = (1..=100).find(|i| !holds(f64::from(*i) * 0.01)) else { return end };
            let (mut kept, mut lost) = (f64::from(lost - 1) * 0.01, f64::from(lost) * 0.01);
            while (lost - kept) * length > 1e-4 {
                let middle = 0.5 * (kept + lost);
                if holds(middle) { kept = middle } else { lost = middle }
            }
            at(kept)
        })
    }

    /// Warning about a material of `tissue` that loses ellipticity in the expected range, if it does.
    #[must_use]
    pub fn stability_warning(&self, tissue: &str) -> Option<Warning> {
        if self.is_polyconvex() {
            return None;
        }
        let ranges: Vec<String> = StandardTest::ALL
            .iter()
            .map(|test| (test, self.elliptic_range(*test)))
            .filter(|(test, range)| *range != test.expected())
            .map(|(test, [low, high])| format!("{low:.3} to {high:.3} {}", test.name()))
            .collect();
        (!ranges.is_empty()).then(|| {
            let message = format!(
                "the material of {tissue} is stable only at stretches of {}; expected are stretches of {} to {} and shears \
                 up to {}",
                ranges.join(", "),
                EXPECTED_STRETCH[0],
                EXPECTED_STRETCH[1],
                EXPECTED_SHEAR[1]
            );
            Warning::check("unstable-material", message).act("Choose a material that is stable at all expected stretches.")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::Materials;

    /// Nearly incompressible, against the closed form: the largest principal stretch reaches sqrt(C10/|C01|).
    #[test]
    fn published_constants_lose_ellipticity_where_the_closed_form_says() {
        let m = Materials::wang2009();
        for (material, limit) in [(m.skin, 1.1100_f64), (m.muscle, 1.1276), (m.fat, 1.0186)] {
            let stiff = Material { bulk: 1e4 * material.bulk, ..material };
            let [low, high] = stiff.elliptic_range(StandardTest::Uniaxial);
            assert!((high - limit).abs() < 3e-4, "{high} {limit}");
            // Under compression l the largest stretch is l^(-1/2).
            assert!((low - limit.powi(-2)).abs() < 3e-4, "{low}");
            let [low, high] = stiff.elliptic_range(StandardTest::Planar);
            assert!((high - limit).abs() < 3e-4 && (low - 1.0 / limit).abs() < 3e-4);
            // Simple shear by l - 1/l is a planar stretch l, rotated.
            let [low, high] = stiff.elliptic_range(StandardTest::Shear);
            let shear = limit - 1.0 / limit;
            assert!((high - shear).abs() < 6e-4 && (low + shear).abs() < 6e-4, "{low} {high} {shear}");
            let warning = material.stability_warning("fat").unwrap();
            assert_eq!(warning.code, "unstable-material");
            assert!(warning.message.contains("fat") && warning.message.contains("uniaxial"), "{warning}");
        }
    }

    #[test]
    fn stable_presets_are_stable_everywhere() {
        for m in [Materials::wang2009_stable(), Materials::wang2009_tension()] {
            for material in [m.skin, m.muscle, m.fat] {
                assert_eq!(material.stability_warning("skin"), None);
                assert!(StandardTest::ALL.iter().all(|t| material.elliptic_range(*t) == t.expected()));
            }
        }
    }
}
