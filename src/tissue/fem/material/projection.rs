use nalgebra::{Matrix3, SVector};

use super::energy::Material;
use super::principal::{Principal, eigen};
use super::tangent::{Inverted, Tangent};

impl Material {
    /// Stress, projected tangent, and smallest eigenvalue of the tangent before projection, MPa.
    ///
    /// The projection sets negative eigenvalues to zero, so that the tangent is positive semi-definite.
    ///
    /// The eigenvalues of an isotropic energy's tangent are known in principal axes: three of the 3x3 matrix d²W/ds_i ds_j, and a
    /// symmetric shear and a rotation in each plane (Smith, de Goes and Kim, ACM Trans Graph 2019).
    ///
    /// # Errors
    /// [`Inverted`] when `det F` is not positive.
    pub fn projected_tangent(&self, f: &Matrix3<f64>) -> Result<(Matrix3<f64>, Tangent, f64), Inverted> {
        let (stress, mut tangent) = self.stress_and_tangent(f)?;
        let axes = Principal::of(f);
        let hessian = self.principal_hessian(&axes.stretches)?;
        let mut smallest = f64::INFINITY;

        let (values, vectors) = eigen(&hessian.scaling);
        for (k, &value) in values.iter().enumerate() {
            smallest = smallest.min(value);
            if value < 0.0 {
                let mode = axes.u * Matrix3::from_diagonal(&vectors.column(k)) * axes.v.transpose();
                subtract(&mut tangent, &mode, value);
            }
        }
        for k in 0..3 {
            let (a, b) = ((k + 1) % 3, (k + 2) % 3);
            for (value, sign) in [(hessian.shear[k], 1.0), (hessian.rotation[k], -1.0)] {
                smallest = smallest.min(value);
                if value < 0.0 {
                    let mode = axes.u.column(a) * axes.v.column(b).transpose()
                        + axes.u.column(b) * axes.v.column(a).transpose() * sign;
                    subtract(&mut tangent, &mode, 0.5 * value);
                }
            }
        }
        Ok((stress, tangent, smallest))
    }
}

/// Subtracts `value mode modeᵀ`.
fn subtract(tangent: &mut Tangent, mode: &Matrix3<f64>, value: f64) {
    let m = SVector::<f64, 9>::from_column_slice(mode.as_slice());
    tangent.ger(-value, &m, &m, 1.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::Materials;
    use crate::fem::material::principal::tests::admissible_gradients;

    /// Against nalgebra's eigenvalues of the whole 9x9 matrix.
    #[test]
    fn projection_agrees_with_the_eigenvalues_of_the_whole_matrix() {
        let mut indefinite = 0;
        for m in [
            Material::neo_hookean(0.07, 0.3),
            Material::neo_hookean(0.01, 0.49),
            Materials::wang2009().skin,
            Material::yeoh([0.006, 0.15, 0.01], 0.45),
        ] {
            for f in admissible_gradients(40, 0.5) {
                let (stress, t) = m.stress_and_tangent(&f).unwrap();
                let (same_stress, projected, smallest) = m.projected_tangent(&f).unwrap();
                assert_eq!(stress, same_stress);
                let whole = t.symmetric_eigen();
                let scale = whole.eigenvalues.amax();
                assert!((whole.eigenvalues.min() - smallest).abs() < 1e-12 * scale);
                let clamped = whole.eigenvalues.map(|v| v.max(0.0));
                let expected = whole.eigenvectors * Tangent::from_diagonal(&clamped) * whole.eigenvectors.transpose();
                assert!((projected - expected).norm() < 1e-12 * scale);
                indefinite += usize::from(smallest < 0.0);
            }
        }
        assert!(indefinite > 30, "only {indefinite} gradients needed projection");
    }
}
