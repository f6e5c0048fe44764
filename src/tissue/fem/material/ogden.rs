//! The one-term Ogden energy, in principal stretches.

use nalgebra::{Matrix3, SVector, Vector3};

use super::principal::{Principal, PrincipalHessian};
use super::tangent::Tangent;

/// `2 mu / alpha² (J^(-alpha/3) (s1^alpha + s2^alpha + s3^alpha) - 3)`, without a volumetric part.
///
/// Small-strain shear modulus `mu`; `alpha = 2` is neo-Hookean, `alpha = -2` is `mu/2 (J^(-4/3) I2 - 3)`.
///
/// # Source
/// Ogden, Proc R Soc Lond A 326, 1972; scaled as in Shergold, Fleck and Radford, Int J Impact Eng 32, 2006.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ogden {
    pub(super) mu: f64,
    pub(super) alpha: f64,
}

/// Quantities shared by the derivatives, at one triple of stretches.
struct Powers {
    /// `s^alpha`.
    p: Vector3<f64>,
    /// Mean of `p`.
    mean: f64,
    /// `2 mu / alpha J^(-alpha/3)`.
    factor: f64,
}

impl Ogden {
    fn powers(&self, s: &Vector3<f64>) -> Powers {
        let p = s.map(|s| s.powf(self.alpha));
        let factor = 2.0 * self.mu / self.alpha * s.product().powf(-self.alpha / 3.0);
        Powers { p, mean: p.sum() / 3.0, factor }
    }

    /// Energy density at stretches with a positive product (required by the derivatives too), MPa.
    pub(super) fn energy(&self, s: &Vector3<f64>) -> f64 {
        let w = self.powers(s);
        // 2 mu / alpha² times 3 (J^(-alpha/3) mean - 1).
        3.0 / self.alpha * (w.factor * w.mean - 2.0 * self.mu / self.alpha)
    }

    /// Derivatives by the stretches: principal nominal stresses, MPa.
    fn gradient(&self, s: &Vector3<f64>) -> Vector3<f64> {
        let w = self.powers(s);
        Vector3::from_fn(|i, _| w.factor * (w.p[i] - w.mean) / s[i])
    }

    pub(super) fn hessian(&self, s: &Vector3<f64>) -> PrincipalHessian {
        let (w, gradient, alpha) = (self.powers(s), self.gradient(s), self.alpha);
        let scaling = Matrix3::from_fn(|i, k| {
            let entry = if i == k {
                alpha / 3.0 * (w.p[i] + w.mean) - (w.p[i] - w.mean)
            } else {
                -alpha / 3.0 * (w.p[i] + w.p[k] - w.mean)
            };
            w.factor * entry / (s[i] * s[k])
        });
        let pair = |k: usize| (s[(k + 1) % 3], s[(k + 2) % 3], gradient[(k + 1) % 3] + gradient[(k + 2) % 3]);
        let shear = Vector3::from_fn(|k, _| {
            let (a, b, _) = pair(k);
            // Divided difference of s^(alpha-1), and of the mean over s.
            w.factor * (power_difference(a, b, alpha - 1.0) + w.mean / (a * b))
        });
        let rotation = Vector3::from_fn(|k, _| {
            let (a, b, sum) = pair(k);
            sum / (a + b)
        });
        PrincipalHessian { scaling, shear, rotation }
    }

    pub(super) fn first_piola(&self, axes: &Principal) -> Matrix3<f64> {
        axes.u * Matrix3::from_diagonal(&self.gradient(&axes.stretches)) * axes.v.transpose()
    }

    /// dP/dF from its eigenmodes: three stretches coupled by `scaling`, and a symmetric shear and a rotation in each plane.
    pub(super) fn tangent(&self, axes: &Principal) -> Tangent {
        let h = self.hessian(&axes.stretches);
        let mode = |m: Matrix3<f64>| SVector::<f64, 9>::from_column_slice(m.as_slice());
        let dyad = |i: usize, k: usize| axes.u.column(i) * axes.v.column(k).transpose();
        let stretches = [0, 1, 2].map(|i| mode(dyad(i, i)));
        let mut t = Tangent::zeros();
        for i in 0..3 {
            for k in 0..3 {
                t.ger(h.scaling[(i, k)], &stretches[i], &stretches[k], 1.0);
            }
            let (a, b) = ((i + 1) % 3, (i + 2) % 3);
            let (there, back) = (dyad(a, b), dyad(b, a));
            for (value, m) in [(h.shear[i], mode(there + back)), (h.rotation[i], mode(there - back))] {
                t.ger(0.5 * value, &m, &m, 1.0);
            }
        }
        t
    }
}

/// `(a^m - b^m) / (a - b)` for positive `a`, `b`, without cancellation where they are close.
fn power_difference(a: f64, b: f64, m: f64) -> f64 {
    let h = (a - b) / b;
    let quotient = if h == 0.0 { m } else { (m * h.ln_1p()).exp_m1() / h };
    b.powf(m - 1.0) * quotient
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::principal::tests::admissible_gradients;
    use crate::fem::material::{Material, Volumetric};

    #[test]
    fn exponents_of_two_are_the_two_terms_of_mooney_rivlin() {
        let (mu, nu) = (0.07, 0.45);
        for (alpha, same) in
            [(2.0, Material::mooney_rivlin(0.5 * mu, 0.0, nu)), (-2.0, Material::mooney_rivlin(0.0, 0.5 * mu, nu))]
        {
            let ogden = Material::ogden(mu, alpha, nu);
            assert!((ogden.shear_modulus() - mu).abs() < 1e-15 && (ogden.poisson_ratio() - nu).abs() < 1e-12);
            for f in admissible_gradients(40, 0.5) {
                let (stress, tangent) = same.stress_and_tangent(&f).unwrap();
                let (p, t) = ogden.stress_and_tangent(&f).unwrap();
                let scale = tangent.norm();
                assert!((ogden.energy(&f).unwrap() - same.energy(&f).unwrap()).abs() < 1e-13 * scale);
                assert!((p - stress).norm() < 1e-12 * scale && (t - tangent).norm() < 1e-12 * scale);
                assert_eq!(ogden.is_elliptic(&f), same.is_elliptic(&f));
            }
        }
    }

    /// Confined stretch, uniaxial tension and simple shear have closed forms.
    #[test]
    fn homogeneous_states_agree_with_closed_forms() {
        for (mu, alpha, nu) in [(0.4, 12.0, 0.49), (0.02, 5.0, 0.45), (0.03, -4.0, 0.3), (0.05, 1.0, 0.4)] {
            let m = Material::ogden(mu, alpha, nu).with_volumetric(Volumetric::Quadratic);
            for l in [0.6f64, 0.9, 1.1, 1.7] {
                // Confined: diag(l, 1, 1).
                let factor = 2.0 * mu / alpha * l.powf(-alpha / 3.0);
                let mean = (l.powf(alpha) + 2.0) / 3.0;
                let along = (factor * (l.powf(alpha) - mean) + m.bulk * (l - 1.0) * l) / l;
                let across = factor * (1.0 - mean) + m.bulk * (l - 1.0) * l;
                let p = m.first_piola(&Matrix3::from_diagonal(&[l, 1.0, 1.0].into())).unwrap();
                let expected = Matrix3::from_diagonal(&[along, across, across].into());
                assert!((p - expected).norm() < 1e-12 * expected.norm(), "{alpha} {l}");
                // Incompressible uniaxial tension, the pressure eliminated: 2 mu / alpha (l^(alpha-1) - l^(-alpha/2-1)).
                let f = Matrix3::from_diagonal(&[l, l.powf(-0.5), l.powf(-0.5)].into());
                let p = m.first_piola(&f).unwrap();
                let nominal = p[(0, 0)] - p[(1, 1)] * l.powf(-1.5);
                let expected = 2.0 * mu / alpha * (l.powf(alpha - 1.0) - l.powf(-0.5 * alpha - 1.0));
                assert!((nominal - expected).abs() < 1e-11 * p.norm().max(expected.abs()), "{alpha} {l}");
            }
            // Simple shear: 2 mu / alpha (l^alpha - l^-alpha) / (l + 1/l) with l = g/2 + sqrt(1 + g²/4).
            for g in [0.01f64, 0.5, 1.2] {
                let l = 0.5 * g + (1.0 + 0.25 * g * g).sqrt();
                let p = m.first_piola(&Matrix3::new(1.0, g, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)).unwrap();
                let expected = 2.0 * mu / alpha * (l.powf(alpha) - l.powf(-alpha)) / (l + 1.0 / l);
                assert!((p[(0, 1)] - expected).abs() < 1e-12 * p.norm(), "{alpha} {g}");
            }
        }
    }

    /// `|A|^p / d^q` is convex in both exactly when `p >= q + 1`: from exponents of 3/2 up in `F`, from 3 up in the cofactor.
    #[test]
    fn polyconvex_exponents_stay_elliptic_and_smaller_ones_do_not() {
        let gradients: Vec<_> = [0.3, 0.8].iter().flat_map(|a| admissible_gradients(150, *a)).collect();
        for alpha in [1.5, 2.0, 8.0, -3.0, -6.0] {
            let m = Material::ogden(0.05, alpha, 0.45);
            assert!(m.is_polyconvex());
            assert!(gradients.iter().all(|f| m.is_elliptic(f)), "{alpha}");
        }
        for alpha in [1.0, -1.0] {
            let m = Material::ogden(0.05, alpha, 0.45);
            assert!(!m.is_polyconvex());
            let stretched = Matrix3::from_diagonal(&[8.0, 0.25, 0.5].into());
            assert!(!m.is_elliptic(&stretched), "{alpha}");
        }
    }
}
