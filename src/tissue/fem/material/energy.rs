use nalgebra::{Matrix3, SVector};

use super::ogden::Ogden;
use super::principal::Principal;
use super::tangent::{Inverted, Tangent};

/// Isochoric part of an energy, a function of `F / J^(1/3)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Isochoric {
    /// `c10 (J^(-2/3) I1 - 3) + c01 (J^(-4/3) I2 - 3)`, MPa (Wang 2009, eq. 0.21, modified to be stress-free at rest). `c01 = 0`
    /// is neo-Hookean.
    MooneyRivlin {
        /// C10, MPa.
        c10: f64,
        /// C01, MPa.
        c01: f64,
    },
    /// `c1 f + c2 f² + c3 f³` with `f = J^(-2/3) I1 - 3`, MPa (Yeoh, Rubber Chem Technol 1993).
    Yeoh {
        /// C1, MPa: half the small-strain shear modulus.
        c1: f64,
        /// C2, MPa.
        c2: f64,
        /// C3, MPa.
        c3: f64,
    },
    /// `2 mu / alpha² (J^(-alpha/3) (s1^alpha + s2^alpha + s3^alpha) - 3)` of the principal stretches (Ogden, Proc R Soc Lond A
    /// 1972).
    Ogden {
        /// Small-strain shear modulus, MPa.
        mu: f64,
        /// Exponent, not 0.
        alpha: f64,
    },
}

/// Volumetric part of an energy, a function of the bulk modulus K and `J = det F`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Volumetric {
    /// `K/4 (J² - 1 - 2 ln J)` (Simo and Taylor, Comput Methods Appl Mech Eng 1991): grows without bound as the volume tends to
    /// zero.
    #[default]
    Logarithmic,
    /// `K/2 (J - 1)²`: finite at zero volume, so that tissue collapses under large pressure.
    Quadratic,
}

impl Volumetric {
    /// Energy divided by K.
    #[inline(always)]
    fn energy(self, j: f64) -> f64 {
        match self {
            // (J² - 1)/4 as a product: near J = 1 the difference of squares would lose digits.
            Self::Logarithmic => 0.25 * (j - 1.0) * (j + 1.0) - 0.5 * (j - 1.0).ln_1p(),
            Self::Quadratic => 0.5 * (j - 1.0) * (j - 1.0),
        }
    }

    /// First derivative by J, divided by K: the mean Cauchy stress of this part over K.
    #[inline(always)]
    fn slope(self, j: f64) -> f64 {
        match self {
            Self::Logarithmic => 0.5 * (j - 1.0) * (1.0 + 1.0 / j),
            Self::Quadratic => j - 1.0,
        }
    }

    /// Second derivative by J, divided by K.
    #[inline(always)]
    fn curvature(self, j: f64) -> f64 {
        match self {
            Self::Logarithmic => 0.5 * (1.0 + 1.0 / (j * j)),
            Self::Quadratic => 1.0,
        }
    }
}

/// A compressible hyperelastic material: isochoric plus volumetric part.
///
/// ```
/// use nalgebra::{Matrix3, Vector3};
/// use prosopon_tissue::fem::material::Material;
///
/// let fat = Material::neo_hookean(0.012, 0.45);
/// let rest = Matrix3::identity();
/// assert!(fat.energy(&rest)?.abs() < 1e-14);
/// assert!(fat.first_piola(&rest)?.norm() < 1e-14);
/// // Simple shear by 0.1 keeps the volume; the shear stress is mu times the shear.
/// let mut shear = rest;
/// shear[(0, 1)] = 0.1;
/// assert!((fat.first_piola(&shear)?[(0, 1)] - 0.0012).abs() < 1e-12);
/// // An inverted element has no energy.
/// assert!(fat.energy(&Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0))).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Isochoric part.
    pub isochoric: Isochoric,
    /// Bulk modulus K, MPa.
    pub bulk: f64,
    /// Volumetric part.
    pub volumetric: Volumetric,
}

/// Derivatives of `W(I1, I2, J)` with `I1 = tr C` and `I2 = (tr² C - tr C²) / 2`; `W` is linear in `I2`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Derivatives {
    pub(super) w1: f64,
    pub(super) w11: f64,
    pub(super) w2: f64,
    pub(super) wj: f64,
    pub(super) w1j: f64,
    pub(super) w2j: f64,
    pub(super) wjj: f64,
}

/// Invariants and their gradients at one `F`, used by stress and tangent.
struct State {
    c: Matrix3<f64>,
    i1: f64,
    i2: f64,
    j: f64,
    /// dJ/dF.
    cofactor: Matrix3<f64>,
}

impl State {
    #[inline(always)]
    fn new(f: &Matrix3<f64>) -> Result<Self, Inverted> {
        let cofactor = cofactor(f);
        let j = f.column(0).dot(&cofactor.column(0));
        if !(j > 0.0 && j.is_finite()) {
            return Err(Inverted { det_f: j });
        }
        let c = f.tr_mul(f);
        Ok(Self { c, i1: c.trace(), i2: cofactor.norm_squared(), j, cofactor })
    }

    /// dI2/dF = 2 (I1 F - F C).
    #[inline(always)]
    fn i2_gradient(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
        (f * self.i1 - f * self.c) * 2.0
    }
}

/// `x^(-1/3)` of a positive normal number, accurate to a few units in the last place.
///
/// An estimate from the exponent's bits is within 3.5 %; the series of `(1 - e)^(-1/3)` up to the third power then refines it
/// twice. The standard library's cube root took a twentieth of a solve.
#[inline(always)]
fn inverse_cube_root(x: f64) -> f64 {
    /// Minimises the largest error of the estimate over three octaves.
    const BITS: u64 = 0x553e_f0f2_7bb2_fec4;
    let refined = |y: f64| {
        let e = 1.0 - x * y * y * y;
        y + y * e * (1.0 / 3.0 + e * (2.0 / 9.0 + e * (14.0 / 81.0)))
    };
    refined(refined(f64::from_bits(BITS - x.to_bits() / 3)))
}

/// `det(F) F^-T`, defined for singular `F` too.
#[inline(always)]
fn cofactor(f: &Matrix3<f64>) -> Matrix3<f64> {
    let [a, b, c] = [f.column(0), f.column(1), f.column(2)];
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// Bulk modulus of a shear modulus and a Poisson ratio: K = 2 mu (1 + nu) / (3 (1 - 2 nu)).
fn bulk_modulus(shear: f64, poisson: f64) -> f64 {
    2.0 * shear * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson))
}

impl Material {
    /// Neo-Hookean with shear modulus `shear` (MPa) and Poisson ratio `poisson`.
    ///
    /// The bulk modulus is K = 2 mu (1 + nu) / (3 (1 - 2 nu)).
    #[must_use]
    pub fn neo_hookean(shear: f64, poisson: f64) -> Self {
        Self::mooney_rivlin(0.5 * shear, 0.0, poisson)
    }

    /// Mooney-Rivlin with constants in MPa and the bulk modulus for Poisson ratio `poisson` at rest.
    #[must_use]
    pub fn mooney_rivlin(c10: f64, c01: f64, poisson: f64) -> Self {
        let bulk = bulk_modulus(2.0 * (c10 + c01), poisson);
        Self { isochoric: Isochoric::MooneyRivlin { c10, c01 }, bulk, volumetric: Volumetric::default() }
    }

    /// Yeoh with constants in MPa and the bulk modulus for Poisson ratio `poisson` at rest.
    #[must_use]
    pub fn yeoh([c1, c2, c3]: [f64; 3], poisson: f64) -> Self {
        Self {
            isochoric: Isochoric::Yeoh { c1, c2, c3 },
            bulk: bulk_modulus(2.0 * c1, poisson),
            volumetric: Volumetric::default(),
        }
    }

    /// One-term Ogden with small-strain shear modulus `shear` (MPa) and exponent `alpha` (not 0).
    ///
    /// The bulk modulus is the one for Poisson ratio `poisson` at rest.
    #[must_use]
    pub fn ogden(shear: f64, alpha: f64, poisson: f64) -> Self {
        Self {
            isochoric: Isochoric::Ogden { mu: shear, alpha },
            bulk: bulk_modulus(shear, poisson),
            volumetric: Volumetric::default(),
        }
    }

    /// This material with another volumetric part.
    #[must_use]
    pub fn with_volumetric(self, volumetric: Volumetric) -> Self {
        Self { volumetric, ..self }
    }

    /// Neo-Hookean with the same small-strain moduli.
    ///
    /// `None` when this material cannot lose ellipticity, or when its shear modulus is not positive.
    #[must_use]
    pub fn stabilised(&self) -> Option<Self> {
        let mu = self.shear_modulus();
        let stable = Self { isochoric: Isochoric::MooneyRivlin { c10: 0.5 * mu, c01: 0.0 }, ..*self };
        (!self.is_polyconvex() && mu > 0.0).then_some(stable)
    }

    /// This material without its volumetric energy.
    #[must_use]
    pub fn isochoric_part(self) -> Self {
        Self { bulk: 0.0, ..self }
    }

    /// This material without its isochoric energy.
    #[must_use]
    pub fn volumetric_part(self) -> Self {
        Self { isochoric: Isochoric::MooneyRivlin { c10: 0.0, c01: 0.0 }, ..self }
    }

    /// This material with a share of its isochoric energy.
    #[must_use]
    pub fn with_isochoric_share(self, share: f64) -> Self {
        let isochoric = match self.isochoric {
            Isochoric::MooneyRivlin { c10, c01 } => Isochoric::MooneyRivlin { c10: share * c10, c01: share * c01 },
            Isochoric::Yeoh { c1, c2, c3 } => Isochoric::Yeoh { c1: share * c1, c2: share * c2, c3: share * c3 },
            Isochoric::Ogden { mu, alpha } => Isochoric::Ogden { mu: share * mu, alpha },
        };
        Self { isochoric, ..self }
    }

    /// Small-strain shear modulus, MPa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        match self.isochoric {
            Isochoric::MooneyRivlin { c10, c01 } => 2.0 * (c10 + c01),
            Isochoric::Yeoh { c1, .. } => 2.0 * c1,
            Isochoric::Ogden { mu, .. } => mu,
        }
    }

    /// Small-strain Poisson ratio.
    #[must_use]
    pub fn poisson_ratio(&self) -> f64 {
        let mu = self.shear_modulus();
        (3.0 * self.bulk - 2.0 * mu) / (2.0 * (3.0 * self.bulk + mu))
    }

    /// The Ogden energy of this material; `None` for other energies.
    pub(super) fn ogden_term(&self) -> Option<Ogden> {
        match self.isochoric {
            Isochoric::Ogden { mu, alpha } => Some(Ogden { mu, alpha }),
            Isochoric::MooneyRivlin { .. } | Isochoric::Yeoh { .. } => None,
        }
    }

    /// Derivatives of the parts that are functions of the invariants: all but [`Ogden`].
    #[inline(always)]
    pub(super) fn derivatives(&self, i1: f64, i2: f64, j: f64) -> Derivatives {
        let root = inverse_cube_root(j);
        let inverse = 1.0 / j;
        let scale = root * root;
        // Slope and curvature by the isochoric first invariant.
        let (slope, curvature, c01) = match self.isochoric {
            Isochoric::Ogden { .. } => (0.0, 0.0, 0.0),
            Isochoric::MooneyRivlin { c10, c01 } => (c10, 0.0, c01),
            Isochoric::Yeoh { c1, c2, c3 } => {
                let f = scale * i1 - 3.0;
                (c1 + f * (2.0 * c2 + 3.0 * f * c3), 2.0 * c2 + 6.0 * f * c3, 0.0)
            }
        };
        let w1 = slope * scale;
        let w2 = c01 * inverse * root;
        let (w1j, w2j) = (-2.0 / 3.0 * w1 * inverse, -4.0 / 3.0 * w2 * inverse);
        // Derivative of the isochoric invariant by J.
        let by_j = -2.0 / 3.0 * scale * inverse * i1;
        Derivatives {
            w1,
            w11: curvature * scale * scale,
            w2,
            wj: w1j * i1 + w2j * i2 + self.bulk * self.volumetric.slope(j),
            w1j: w1j + curvature * scale * by_j,
            w2j,
            wjj: (-5.0 / 3.0 * w1j * i1 - 7.0 / 3.0 * w2j * i2) * inverse
                + curvature * by_j * by_j
                + self.bulk * self.volumetric.curvature(j),
        }
    }

    /// Energy density, MPa = mJ/mm³.
    ///
    /// # Errors
    /// [`Inverted`] when `det F` is not positive.
    #[inline(always)]
    pub fn energy(&self, f: &Matrix3<f64>) -> Result<f64, Inverted> {
        let s = State::new(f)?;
        let root = inverse_cube_root(s.j);
        let shift = s.i1 * root * root - 3.0;
        let isochoric = match self.isochoric {
            Isochoric::MooneyRivlin { c10, c01 } => c10 * shift + c01 * (s.i2 * root / s.j - 3.0),
            Isochoric::Yeoh { c1, c2, c3 } => shift * (c1 + shift * (c2 + shift * c3)),
            Isochoric::Ogden { mu, alpha } => Ogden { mu, alpha }.energy(&Principal::of(f).stretches),
        };
        Ok(isochoric + self.bulk * self.volumetric.energy(s.j))
    }

    /// First Piola-Kirchhoff stress, MPa.
    ///
    /// # Errors
    /// [`Inverted`] when `det F` is not positive.
    #[inline(always)]
    pub fn first_piola(&self, f: &Matrix3<f64>) -> Result<Matrix3<f64>, Inverted> {
        let s = State::new(f)?;
        let d = self.derivatives(s.i1, s.i2, s.j);
        let stress = f * (2.0 * d.w1) + s.i2_gradient(f) * d.w2 + s.cofactor * d.wj;
        Ok(match self.ogden_term() {
            Some(ogden) => stress + ogden.first_piola(&Principal::of(f)),
            None => stress,
        })
    }

    /// First Piola-Kirchhoff stress and the tangent dP/dF, MPa.
    ///
    /// # Errors
    /// [`Inverted`] when `det F` is not positive.
    #[inline(always)]
    pub fn stress_and_tangent(&self, f: &Matrix3<f64>) -> Result<(Matrix3<f64>, Tangent), Inverted> {
        let s = State::new(f)?;
        let d = self.derivatives(s.i1, s.i2, s.j);
        let i2_gradient = s.i2_gradient(f);
        let mut stress = f * (2.0 * d.w1) + i2_gradient * d.w2 + s.cofactor * d.wj;

        // Second derivatives in the invariants: g hᵀ + h gᵀ with g = dJ/dF.
        let half = f * (2.0 * d.w1j) + i2_gradient * d.w2j + s.cofactor * (0.5 * d.wjj);
        let g = SVector::<f64, 9>::from_column_slice(s.cofactor.as_slice());
        let h = SVector::<f64, 9>::from_column_slice(half.as_slice());
        let mut t = g * h.transpose();
        t += t.transpose();
        if d.w11 != 0.0 {
            let f = SVector::<f64, 9>::from_column_slice(f.as_slice());
            t.ger(4.0 * d.w11, &f, &f, 1.0);
        }
        add_second_derivative_of_j(&mut t, &(f * d.wj));
        for a in 0..9 {
            t[(a, a)] += 2.0 * d.w1;
        }
        if d.w2 != 0.0 {
            add_second_derivative_of_i2(&mut t, f, &s, d.w2);
        }
        if let Some(ogden) = self.ogden_term() {
            let axes = Principal::of(f);
            stress += ogden.first_piola(&axes);
            t += ogden.tangent(&axes);
        }
        Ok((stress, t))
    }
}

/// Adds d²J/dF², times the factor already in `f`: the derivative of `b x c` by `b` is `-[c]x`.
#[inline(always)]
fn add_second_derivative_of_j(t: &mut Tangent, f: &Matrix3<f64>) {
    for (row, col, sign, of) in [(0, 1, -1.0, 2), (0, 2, 1.0, 1), (1, 2, -1.0, 0)] {
        let [x, y, z] = [sign * f[(0, of)], sign * f[(1, of)], sign * f[(2, of)]];
        let (r, c) = (3 * row, 3 * col);
        for (i, k, v) in [(0, 1, -z), (0, 2, y), (1, 0, z), (1, 2, -x), (2, 0, -y), (2, 1, x)] {
            t[(r + i, c + k)] += v;
            t[(c + k, r + i)] += v;
        }
    }
}

/// Adds `factor` d²I2/dF²: applied to `A` it is 4 (F:A) F + 2 I1 A - 2 A C - 2 F Aᵀ F - 2 F Fᵀ A.
#[inline(always)]
fn add_second_derivative_of_i2(t: &mut Tangent, f: &Matrix3<f64>, s: &State, factor: f64) {
    let b = f * f.transpose();
    let w = 2.0 * factor;
    for col in 0..3 {
        for k in 0..3 {
            for row in 0..3 {
                for i in 0..3 {
                    let mut v = 2.0 * f[(i, row)] * f[(k, col)] - f[(i, col)] * f[(k, row)];
                    if i == k {
                        v -= s.c[(row, col)];
                    }
                    if row == col {
                        v -= b[(i, k)];
                    }
                    t[(3 * row + i, 3 * col + k)] += w * v;
                }
            }
            t[(3 * col + k, 3 * col + k)] += w * s.i1;
        }
    }
}

#[cfg(test)]
mod tests;
