use nalgebra::Matrix3;

use super::energy::{Isochoric, Material};
use super::principal::{Principal, PrincipalHessian};

impl Material {
    /// Whether the energy is polyconvex, and so elliptic wherever `det F > 0`.
    ///
    /// It is for neo-Hookean and Yeoh with non-negative constants, and for Ogden with an exponent of at least 3/2 or at most -3.
    /// (`J^(-4/3) I2` is not polyconvex, only its power 3/2 is: Hartmann and Neff, Int J Solids Struct 2003, whose `|A|^p / d^q`
    /// with `p >= q + 1` gives the exponents too.)
    #[must_use]
    pub fn is_polyconvex(&self) -> bool {
        let isochoric = match self.isochoric {
            Isochoric::MooneyRivlin { c10, c01 } => c10 >= 0.0 && c01 == 0.0,
            Isochoric::Yeoh { c1, c2, c3 } => c1 >= 0.0 && c2 >= 0.0 && c3 >= 0.0,
            Isochoric::Ogden { mu, alpha } => mu >= 0.0 && (alpha >= 1.5 || alpha <= -3.0),
        };
        isochoric && self.bulk >= 0.0
    }

    /// Whether the tangent at `f` is strongly elliptic; false where `f` is not admissible.
    ///
    /// Strong ellipticity means `(a⊗b) : T : (a⊗b) > 0` for all non-zero `a`, `b`, so that every acoustic tensor is positive
    /// definite.
    ///
    /// The test is exact, without sampling. With `p_i = a_i b_i` in principal axes, the form has as its attained lower bound a
    /// quadratic form in `|p|`, one for each choice of signs; so strict copositivity of these 3x3 matrices and the Baker-Ericksen
    /// inequalities decide (Simpson and Spector, Arch Ration Mech Anal 1983; Dacorogna, Discrete Contin Dyn Syst B 2001).
    #[must_use]
    pub fn is_elliptic(&self, f: &Matrix3<f64>) -> bool {
        let det = f.determinant();
        if !(det > 0.0 && det.is_finite()) {
            return false;
        }
        self.principal_hessian(&Principal::of(f).stretches).is_ok_and(|h| strongly_elliptic(&h))
    }
}

fn strongly_elliptic(h: &PrincipalHessian) -> bool {
    let baker_ericksen = (0..3).all(|k| h.shear[k] + h.rotation[k] > 0.0);
    // Signs of p up to a common factor.
    let signs = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]];
    baker_ericksen
        && signs.iter().all(|sign| {
            let mut m = h.scaling;
            for k in 0..3 {
                let (a, b) = ((k + 1) % 3, (k + 2) % 3);
                let equal = sign[a] * sign[b] > 0.0;
                let off = if equal { m[(a, b)] + h.shear[k] } else { h.rotation[k] - m[(a, b)] };
                m[(a, b)] = off;
                m[(b, a)] = off;
            }
            strictly_copositive(&m)
        })
}

/// `pᵀ M p > 0` for all non-zero `p >= 0` (Hadeler, Linear Algebra Appl 1983).
fn strictly_copositive(m: &Matrix3<f64>) -> bool {
    let d = m.diagonal();
    if d.min() <= 0.0 {
        return false;
    }
    let root = d.map(f64::sqrt);
    let pair = |i: usize, j: usize| m[(i, j)] + root[i] * root[j];
    let (p01, p02, p12) = (pair(0, 1), pair(0, 2), pair(1, 2));
    if p01 <= 0.0 || p02 <= 0.0 || p12 <= 0.0 {
        return false;
    }
    root[0] * root[1] * root[2]
        + m[(0, 1)] * root[2]
        + m[(0, 2)] * root[1]
        + m[(1, 2)] * root[0]
        + (2.0 * p01 * p02 * p12).sqrt()
        > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::principal::tests::admissible_gradients;
    use crate::fem::material::{Materials, Tangent};
    use nalgebra::Vector3;

    /// Smallest eigenvalue of the acoustic tensor over a dense set of directions.
    fn sampled(t: &Tangent) -> f64 {
        let n = 60;
        let mut least = f64::INFINITY;
        for i in 0..=n {
            let theta = std::f64::consts::PI * f64::from(i) / f64::from(n);
            for j in 0..2 * n {
                let phi = std::f64::consts::PI * f64::from(j) / f64::from(n);
                let b = Vector3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                let q = Matrix3::from_fn(|r, k| {
                    (0..9).map(|x| t[(r + 3 * (x / 3), k + 3 * (x % 3))] * b[x / 3] * b[x % 3]).sum::<f64>()
                });
                least = least.min(q.symmetric_eigenvalues().min());
            }
        }
        least
    }

    #[test]
    fn closed_form_agrees_with_sampled_acoustic_tensors() {
        let (mut lost, mut kept) = (0, 0);
        let m = Materials::wang2009();
        for material in
            [m.skin, m.muscle, m.fat, Material::neo_hookean(0.07, 0.3), Material::yeoh([0.02, -0.05, 0.0], 0.45)]
        {
            for amplitude in [0.02, 0.08, 0.3, 0.6] {
                for f in admissible_gradients(12, amplitude) {
                    let (_, t) = material.stress_and_tangent(&f).unwrap();
                    let least = sampled(&t);
                    // The error of sampling at the minimum is about the squared step between directions.
                    if least.abs() > 3e-3 * t.norm() || least < 0.0 {
                        assert_eq!(material.is_elliptic(&f), least > 0.0, "{least} {f}");
                        lost += usize::from(least < 0.0);
                        kept += usize::from(least > 0.0);
                    }
                }
            }
        }
        assert!(lost > 40 && kept > 40, "{lost} lost, {kept} kept");
    }

    /// Incompressible closed form: ellipticity is lost when the largest principal stretch exceeds sqrt(C10/|C01|). An independent
    /// table gives 1.1101, 1.1276, 1.0186 in uniaxial tension, 0.8116, 0.7864, 0.9638 in compression, 0.9008, 0.8868, 0.9817 in
    /// planar compression.
    #[test]
    fn published_constants_lose_ellipticity_at_the_known_stretches() {
        let m = Materials::wang2009();
        let table =
            [(m.skin, 1.1101, 0.8116, 0.9008), (m.muscle, 1.1276, 0.7864, 0.8868), (m.fat, 1.0186, 0.9638, 0.9817)];
        let uniaxial = |l: f64| Matrix3::from_diagonal(&Vector3::new(l, l.powf(-0.5), l.powf(-0.5)));
        let plane = |l: f64| Matrix3::from_diagonal(&Vector3::new(l, 1.0, 1.0 / l));
        for (material, tension, compression, planar) in table {
            let limit = |m: &Material, towards: f64, path: &dyn Fn(f64) -> Matrix3<f64>| {
                let (mut kept, mut lost) = (1.0, towards);
                while f64::abs(kept - lost) > 1e-6 {
                    let middle = 0.5 * (kept + lost);
                    *(if m.is_elliptic(&path(middle)) { &mut kept } else { &mut lost }) = middle;
                }
                lost
            };
            let nearly_incompressible = Material { bulk: 1e4 * material.bulk, ..material };
            for (towards, path, expected) in
                [(1.5, &uniaxial as &dyn Fn(f64) -> _, tension), (0.5, &uniaxial, compression), (0.5, &plane, planar)]
            {
                // The table has four decimals.
                let found = limit(&nearly_incompressible, towards, path);
                assert!((found - expected).abs() < 1.2e-4, "{found} {expected}");
                // A compressible tangent can lose ellipticity earlier, never later.
                let compressible = limit(&material, towards, path);
                assert!((compressible - 1.0).abs() < (expected - 1.0).abs() + 1.2e-4);
            }
        }
        let stable = Materials::wang2009_stable();
        for l in [0.5, 0.7, 1.3, 2.0] {
            let f = Matrix3::from_diagonal(&Vector3::new(l, 1.0, 1.0 / l));
            assert!(stable.skin.is_elliptic(&f) && stable.muscle.is_elliptic(&f) && stable.fat.is_elliptic(&f));
        }
    }
}
