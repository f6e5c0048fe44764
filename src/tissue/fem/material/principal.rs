use nalgebra::{Matrix3, Vector3};

/// `F = U diag(stretches) Vᵀ`, by one-sided Jacobi rotations: accurate for small stretches too, and exact for a diagonal `F`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Principal {
    pub(super) u: Matrix3<f64>,
    pub(super) v: Matrix3<f64>,
    pub(super) stretches: Vector3<f64>,
}

/// Second derivatives of an isotropic energy in principal axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrincipalHessian {
    /// d²W / d stretch_i d stretch_j.
    pub(super) scaling: Matrix3<f64>,
    /// For each axis `k` and the plane of the other two axes `i, j`: `(W_i - W_j) / (s_i - s_j)`, the eigenvalue of a symmetric
    /// shear.
    pub(super) shear: Vector3<f64>,
    /// `(W_i + W_j) / (s_i + s_j)`, the eigenvalue of a rotation.
    pub(super) rotation: Vector3<f64>,
}

const SWEEPS: usize = 12;

/// Cosine and sine of the rotation that makes a symmetric 2x2 matrix (diagonal `a`, `b`, other entry `c`) diagonal.
fn rotation(a: f64, b: f64, c: f64) -> (f64, f64) {
    let zeta = (b - a) / (2.0 * c);
    let tan = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
    let cos = 1.0 / (1.0 + tan * tan).sqrt();
    (cos, cos * tan)
}

/// Eigenvalues of a symmetric matrix and their eigenvectors as columns, by Jacobi rotations.
pub(super) fn eigen(matrix: &Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let (mut m, mut v) = (*matrix, Matrix3::identity());
    for _ in 0..SWEEPS {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b, c) = (m[(p, p)], m[(q, q)], m[(p, q)]);
            // Negligible against the smaller diagonal entry, or against rounding of the larger one.
            if c == 0.0 || c.abs() < 1e-16 * (a.abs() + b.abs()) {
                continue;
            }
            turned = true;
            let (cos, sin) = rotation(a, b, c);
            let r = 3 - p - q;
            let (rp, rq) = (m[(r, p)], m[(r, q)]);
            m[(p, p)] = a - c * sin / cos;
            m[(q, q)] = b + c * sin / cos;
            (m[(p, q)], m[(q, p)]) = (0.0, 0.0);
            (m[(r, p)], m[(r, q)]) = (cos * rp - sin * rq, sin * rp + cos * rq);
            (m[(p, r)], m[(q, r)]) = (m[(r, p)], m[(r, q)]);
            for i in 0..3 {
                let (vp, vq) = (v[(i, p)], v[(i, q)]);
                (v[(i, p)], v[(i, q)]) = (cos * vp - sin * vq, sin * vp + cos * vq);
            }
        }
        if !turned {
            break;
        }
    }
    (m.diagonal(), v)
}

impl Principal {
    /// `f` must have a positive determinant.
    pub(super) fn of(f: &Matrix3<f64>) -> Self {
        let mut columns = [f.column(0).into_owned(), f.column(1).into_owned(), f.column(2).into_owned()];
        let mut v = [Vector3::x(), Vector3::y(), Vector3::z()];
        for _ in 0..SWEEPS {
            let mut turned = false;
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                let (a, b) = (columns[p].norm_squared(), columns[q].norm_squared());
                let c = columns[p].dot(&columns[q]);
                if c * c <= 1e-30 * a * b {
                    continue;
                }
                turned = true;
                let (cos, sin) = rotation(a, b, c);
                (columns[p], columns[q]) = (columns[p] * cos - columns[q] * sin, columns[p] * sin + columns[q] * cos);
                (v[p], v[q]) = (v[p] * cos - v[q] * sin, v[p] * sin + v[q] * cos);
            }
            if !turned {
                break;
            }
        }
        let stretches = Vector3::new(columns[0].norm(), columns[1].norm(), columns[2].norm());
        for (column, stretch) in columns.iter_mut().zip(stretches.iter()) {
            *column /= *stretch;
        }
        Self { u: Matrix3::from_columns(&columns), v: Matrix3::from_columns(&v), stretches }
    }
}

#[cfg(test)]
pub(in crate::fem::material) mod tests {
    use super::*;

    /// Reproducible deformation gradients with a positive determinant and entries within `amplitude` of those of a rotation.
    pub(in crate::fem::material) fn admissible_gradients(count: usize, amplitude: f64) -> Vec<Matrix3<f64>> {
        let mut state = 0x9E37_79B9_7F4A_7C15_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let mut found = Vec::new();
        while found.len() < count {
            let q = nalgebra::Rotation3::from_euler_angles(3.0 * next(), 3.0 * next(), 3.0 * next());
            let f = q.into_inner() + Matrix3::from_fn(|_, _| amplitude * next());
            if f.determinant() > 0.1 {
                found.push(f);
            }
        }
        found
    }

    #[test]
    fn eigenvalues_and_vectors_give_the_matrix_back() {
        let mut matrices: Vec<_> = admissible_gradients(50, 0.9).iter().map(|f| f + f.transpose()).collect();
        matrices.push(Matrix3::repeat(1.0));
        matrices.push(Matrix3::new(1.0, 1e-9, 0.0, 1e-9, 1.0, 0.0, 0.0, 0.0, -1e6));
        for m in matrices {
            let (values, vectors) = eigen(&m);
            let back = vectors * Matrix3::from_diagonal(&values) * vectors.transpose();
            assert!((back - m).norm() < 1e-14 * m.norm());
            assert!((vectors.tr_mul(&vectors) - Matrix3::identity()).norm() < 1e-14);
        }
    }

    #[test]
    fn principal_axes_give_the_gradient_back() {
        let mut gradients = admissible_gradients(50, 0.6);
        gradients.push(Matrix3::from_diagonal(&Vector3::new(1e-9, 1.0, 1e3)));
        gradients.push(Matrix3::identity());
        for f in gradients {
            let p = Principal::of(&f);
            let back = p.u * Matrix3::from_diagonal(&p.stretches) * p.v.transpose();
            assert!((back - f).norm() < 1e-14 * f.norm());
            assert!((p.u.tr_mul(&p.u) - Matrix3::identity()).norm() < 1e-13);
            assert!((p.v.tr_mul(&p.v) - Matrix3::identity()).norm() < 1e-14);
        }
    }
}
