//! Where on standard tests a material stays well posed.

use super::energy::Material;
use nalgebra::{Matrix3, Vector3};

/// Stretches between which tissue is looked at: from half its length to twice.
pub const EXPECTED_STRETCH: [f64; 2] = [0.5, 2.0];

/// A standard test. Volume is kept, as soft tissue nearly does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StandardTest {
    /// Stretch along one axis, the others alike.
    Uniaxial,
    /// The same stretch along two axes.
    Equibiaxial,
    /// Stretch along one axis, none along the second.
    Planar,
}

impl StandardTest {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Uniaxial, Self::Equibiaxial, Self::Planar];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniaxial => "uniaxial",
            Self::Equibiaxial => "equibiaxial",
            Self::Planar => "planar",
        }
    }

    /// Deformation gradient at `stretch`.
    #[must_use]
    pub fn deformation(self, stretch: f64) -> Matrix3<f64> {
        let l = stretch;
        Matrix3::from_diagonal(&match self {
            Self::Uniaxial => Vector3::new(l, l.powf(-0.5), l.powf(-0.5)),
            Self::Equibiaxial => Vector3::new(l, l, l.powi(-2)),
            Self::Planar => Vector3::new(l, 1.0, 1.0 / l),
        })
    }
}

impl Material {
    /// Smallest and largest stretch of `test` within [`EXPECTED_STRETCH`] up to which the material stays strongly elliptic, from rest on;
    /// to 1e-4.
    #[must_use]
    pub fn elliptic_range(&self, test: StandardTest) -> [f64; 2] {
        EXPECTED_STRETCH.map(|end| {
            // In logarithmic steps of a hundredth of the way, then by halving.
            let at = |share: f64| end.powf(share);
            let holds = |share: f64| self.is_elliptic(&test.deformation(at(share)));
            if !holds(0.0) {
                return 1.0;
            }
            let Some(lost) = (1..=100).find(|i| !holds(f64::from(*i) * 0.01)) else { return end };
            let (mut kept, mut lost) = (f64::from(lost - 1) * 0.01, f64::from(lost) * 0.01);
            while (lost - kept) * end.ln().abs() > 1e-4 {
                let middle = 0.5 * (kept + lost);
                if holds(middle) { kept = middle } else { lost = middle }
            }
            at(kept)
        })
    }

    /// What to tell about a material of `tissue` that is not elliptic in all of the expected range; `None` when it is.
    #[must_use]
    pub fn stability_warning(&self, tissue: &str) -> Option<String> {
        if self.is_polyconvex() {
            return None;
        }
        let ranges: Vec<String> = StandardTest::ALL
            .iter()
            .map(|test| (test, self.elliptic_range(*test)))
            .filter(|(_, range)| *range != EXPECTED_STRETCH)
            .map(|(test, [low, high])| format!("{low:.3} to {high:.3} {}", test.name()))
            .collect();
        (!ranges.is_empty()).then(|| {
            format!(
                "the material of {tissue} is stable only at stretches of {}; expected are {} to {}",
                ranges.join(", "),
                EXPECTED_STRETCH[0],
                EXPECTED_STRETCH[1]
            )
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
            let warning = material.stability_warning("fat").unwrap();
            assert!(
                warning.contains("the material of fat is stable only") && warning.contains("uniaxial"),
                "{warning}"
            );
        }
    }

    #[test]
    fn stable_presets_are_stable_everywhere() {
        for m in [Materials::wang2009_stable(), Materials::wang2009_tension()] {
            for material in [m.skin, m.muscle, m.fat] {
                assert_eq!(material.stability_warning("skin"), None);
                assert!(StandardTest::ALL.iter().all(|t| material.elliptic_range(*t) == EXPECTED_STRETCH));
            }
        }
    }
}
