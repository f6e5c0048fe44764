use nalgebra::Vector3;

use super::energy::Material;
use super::principal::PrincipalHessian;
use super::tangent::Inverted;

impl Material {
    /// Second derivatives at principal stretches with a positive product. The quotients of [`PrincipalHessian`] are divided out
    /// analytically, so equal stretches need no limit.
    pub(super) fn principal_hessian(&self, stretches: &Vector3<f64>) -> Result<PrincipalHessian, Inverted> {
        let s = stretches;
        let j = s[0] * s[1] * s[2];
        if !(j > 0.0 && j.is_finite()) {
            return Err(Inverted { det_f: j });
        }
        let jacobi = Vector3::new(s[1] * s[2], s[2] * s[0], s[0] * s[1]);
        let d = self.derivatives(s.norm_squared(), jacobi.norm_squared(), j);
        let sq = s.component_mul(s);
        let others = Vector3::repeat(sq.sum()) - sq;
        let i2_gradient = s.component_mul(&others) * 2.0;
        let half = s * (2.0 * d.w1j) + i2_gradient * d.w2j + jacobi * (0.5 * d.wjj);

        let mut scaling = jacobi * half.transpose();
        scaling += scaling.transpose();
        scaling += s * s.transpose() * (4.0 * d.w11);
        let mut shear = Vector3::zeros();
        let mut rotation = Vector3::zeros();
        for k in 0..3 {
            let (a, b) = ((k + 1) % 3, (k + 2) % 3);
            scaling[(k, k)] += 2.0 * d.w1 + 2.0 * d.w2 * others[k];
            let mixed = 4.0 * d.w2 * s[a] * s[b] + d.wj * s[k];
            scaling[(a, b)] += mixed;
            scaling[(b, a)] += mixed;
            shear[k] = 2.0 * d.w1 + 2.0 * d.w2 * (sq[k] - s[a] * s[b]) - d.wj * s[k];
            rotation[k] = 2.0 * d.w1 + 2.0 * d.w2 * (sq[k] + s[a] * s[b]) + d.wj * s[k];
        }
        if let Some(ogden) = self.ogden_term() {
            let h = ogden.hessian(s);
            scaling += h.scaling;
            shear += h.shear;
            rotation += h.rotation;
        }
        Ok(PrincipalHessian { scaling, shear, rotation })
    }
}
