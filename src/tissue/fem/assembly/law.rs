use crate::fem::material::{Inverted, Material, Tangent};
use nalgebra::{Matrix3, SVector};

/// Relation of stress and deformation gradient in an element.
#[derive(Debug, Clone)]
pub(in crate::fem) enum Law {
    /// The hyperelastic energy, at any strain.
    Hyperelastic(Material),
    /// The quadratic expansion of the energy about rest, `1/2 (F - I) : C : (F - I)`. `C` has the minor symmetries, so only
    /// the symmetric part of `F - I` counts. It is defined for inverted elements too.
    SmallStrain(Box<Tangent>),
}

/// Treatment of negative eigenvalues of the tangent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::fem) enum Curvature {
    /// Keep them: exact Newton's method.
    Exact,
    /// Set them to zero: the assembled matrix is positive semi-definite.
    Projected,
}

impl Law {
    /// The small-strain law of `material`.
    pub(in crate::fem) fn small_strain(material: &Material) -> Result<Self, Inverted> {
        let (_, tangent) = material.stress_and_tangent(&Matrix3::identity())?;
        Ok(Self::SmallStrain(Box::new(tangent)))
    }

    #[inline(always)]
    pub(super) fn energy(&self, f: &Matrix3<f64>) -> Result<f64, Inverted> {
        match self {
            Self::Hyperelastic(material) => material.energy(f),
            Self::SmallStrain(c) => {
                let strain = column(&(f - Matrix3::identity()));
                Ok(0.5 * strain.dot(&(**c * strain)))
            }
        }
    }

    #[inline(always)]
    pub(super) fn stress(&self, f: &Matrix3<f64>) -> Result<Matrix3<f64>, Inverted> {
        match self {
            Self::Hyperelastic(material) => material.first_piola(f),
            Self::SmallStrain(c) => Ok(matrix(&(**c * column(&(f - Matrix3::identity()))))),
        }
    }

    /// Cauchy stress, MPa; zero where `f` is inverted. With small strain all stress measures agree.
    pub(super) fn cauchy(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
        let stress = self.stress(f).unwrap_or_else(|_| Matrix3::zeros());
        match self {
            Self::Hyperelastic(_) => stress * f.transpose() / f.determinant(),
            Self::SmallStrain(_) => stress,
        }
    }

    #[inline(always)]
    pub(super) fn stress_and_tangent(
        &self,
        f: &Matrix3<f64>,
        curvature: Curvature,
    ) -> Result<(Matrix3<f64>, Tangent), Inverted> {
        match (self, curvature) {
            (Self::Hyperelastic(material), Curvature::Exact) => material.stress_and_tangent(f),
            (Self::Hyperelastic(material), Curvature::Projected) => {
                material.projected_tangent(f).map(|(stress, tangent, _)| (stress, tangent))
            }
            (Self::SmallStrain(c), _) => Ok((matrix(&(**c * column(&(f - Matrix3::identity())))), **c)),
        }
    }
}

fn column(m: &Matrix3<f64>) -> SVector<f64, 9> {
    SVector::from_column_slice(m.as_slice())
}

pub(super) fn matrix(v: &SVector<f64, 9>) -> Matrix3<f64> {
    Matrix3::from_column_slice(v.as_slice())
}
