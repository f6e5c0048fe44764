use super::*;

#[test]
fn the_inverse_cube_root_is_right_to_the_last_places() {
    for k in -2000..2000 {
        let x = (f64::from(k) * 0.0137).exp();
        let error = inverse_cube_root(x) * x.cbrt() - 1.0;
        assert!(error.abs() < 4.0 * f64::EPSILON, "{x}: {error:e}");
    }
    for x in [f64::MIN_POSITIVE, 1e-300, 1e300, f64::MAX] {
        assert!((inverse_cube_root(x) * x.cbrt() - 1.0).abs() < 4.0 * f64::EPSILON, "{x}");
    }
}
use crate::fem::material::Materials;
use crate::fem::material::principal::tests::admissible_gradients;

fn materials() -> Vec<Material> {
    let m = Materials::wang2009();
    vec![
        Material::mooney_rivlin(4.7105788e-3, 1.1776447e-3, 0.45),
        Material::neo_hookean(0.07, 0.3),
        Material::neo_hookean(0.01, 0.49),
        m.skin,
        m.fat,
        Material::yeoh([0.035, 0.14, 0.05], 0.45),
        Material::yeoh([0.006, 0.15, 0.0], 0.49),
        Material::ogden(0.05, 3.5, 0.45),
        Material::ogden(0.02, -4.0, 0.3),
        Material::ogden(0.07, 1.2, 0.49),
        Material::neo_hookean(0.07, 0.3).with_volumetric(Volumetric::Quadratic),
        Material::ogden(0.05, 3.5, 0.45).with_volumetric(Volumetric::Quadratic),
    ]
}

fn basis(a: usize) -> Matrix3<f64> {
    let mut m = Matrix3::zeros();
    m[a] = 1.0;
    m
}

#[test]
fn rest_is_free_of_energy_and_stress_and_has_the_moduli() {
    for m in materials() {
        let scale = m.shear_modulus() + m.bulk;
        assert!(m.energy(&Matrix3::identity()).unwrap().abs() < 1e-15 * scale);
        assert!(m.first_piola(&Matrix3::identity()).unwrap().norm() < 1e-14 * scale);
        let (_, t) = m.stress_and_tangent(&Matrix3::identity()).unwrap();
        // Hooke: T[(ij),(kl)] = lambda d_ij d_kl + mu (d_ik d_jl + d_il d_jk).
        let (mu, lambda) = (m.shear_modulus(), m.bulk - 2.0 / 3.0 * m.shear_modulus());
        let hooke = Tangent::from_fn(|a, b| {
            let (i, j, k, l) = (a % 3, a / 3, b % 3, b / 3);
            let d = |p: usize, q: usize| f64::from(u8::from(p == q));
            lambda * d(i, j) * d(k, l) + mu * (d(i, k) * d(j, l) + d(i, l) * d(j, k))
        });
        assert!((t - hooke).norm() < 1e-14 * scale);
    }
    let nu = Material::neo_hookean(0.02, 0.45).poisson_ratio();
    assert!((nu - 0.45).abs() < 1e-14);
}

/// Central differences at two steps: the error must fall with h² until rounding dominates.
#[test]
fn stress_and_tangent_are_derivatives_of_the_energy() {
    for m in materials() {
        for f in admissible_gradients(12, 0.35) {
            let (p, t) = m.stress_and_tangent(&f).unwrap();
            assert!((p - m.first_piola(&f).unwrap()).norm() <= 1e-14 * p.norm());
            assert!((t - t.transpose()).norm() <= 1e-14 * t.norm());
            let error = |h: f64| {
                let mut worst: (f64, f64) = (0.0, 0.0);
                for a in 0..9 {
                    let (plus, minus) = (f + basis(a) * h, f - basis(a) * h);
                    let de = (m.energy(&plus).unwrap() - m.energy(&minus).unwrap()) / (2.0 * h);
                    let dp = (m.first_piola(&plus).unwrap() - m.first_piola(&minus).unwrap()) / (2.0 * h);
                    worst.0 = worst.0.max((de - p[a]).abs());
                    let column = Matrix3::from_column_slice(t.column(a).as_slice());
                    worst.1 = worst.1.max((dp - column).norm());
                }
                worst
            };
            let (coarse, fine) = (error(1e-3), error(1e-4));
            let scale = t.norm();
            assert!(fine.0 < 0.02 * coarse.0 + 1e-11 * scale, "{coarse:?} {fine:?}");
            assert!(fine.1 < 0.02 * coarse.1 + 1e-11 * scale, "{coarse:?} {fine:?}");
            assert!(fine.0 < 1e-6 * scale && fine.1 < 1e-6 * scale);
        }
    }
}

#[test]
fn a_rotation_turns_the_stress_and_keeps_the_energy() {
    let q = nalgebra::Rotation3::from_euler_angles(0.7, -1.1, 2.3).into_inner();
    for m in materials() {
        for f in admissible_gradients(8, 0.3) {
            let (e, p) = (m.energy(&f).unwrap(), m.first_piola(&f).unwrap());
            let scale = m.bulk;
            assert!((m.energy(&(q * f)).unwrap() - e).abs() < 1e-13 * scale);
            assert!((m.first_piola(&(q * f)).unwrap() - q * p).norm() < 1e-13 * scale);
            // Isotropy: a rotation before the deformation changes nothing.
            assert!((m.energy(&(f * q)).unwrap() - e).abs() < 1e-13 * scale);
        }
    }
}

#[test]
fn inverted_and_broken_gradients_are_refused() {
    let m = Material::neo_hookean(1.0, 0.3);
    let mirrored = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, -1.0));
    for f in [mirrored, Matrix3::zeros(), Matrix3::repeat(f64::NAN), Matrix3::identity() * f64::INFINITY] {
        assert!(m.energy(&f).is_err() && m.first_piola(&f).is_err() && m.stress_and_tangent(&f).is_err());
        assert!(m.projected_tangent(&f).is_err());
        assert!(!m.is_elliptic(&f));
    }
    assert_eq!(m.energy(&mirrored), Err(Inverted { det_f: -1.0 }));
}

/// Compressed to a millionth of the volume, by the formulas.
#[test]
fn the_logarithmic_energy_resists_collapse_where_the_quadratic_one_does_not() {
    let material = Material::neo_hookean(0.07, 0.45);
    let energy = |m: &Material, j: f64| m.energy(&(Matrix3::identity() * f64::cbrt(j))).unwrap() / m.bulk;
    assert!((energy(&material, 1e-6) - 0.25 * (-1.0 + 12.0 * 10f64.ln())).abs() < 1e-6);
    let quadratic = material.with_volumetric(Volumetric::Quadratic);
    assert!((energy(&quadratic, 1e-6) - 0.5).abs() < 1e-5);
    // Both agree at small strain.
    let small = [material, quadratic].map(|m| energy(&m, 1.001));
    assert!((small[0] / small[1] - 1.0).abs() < 1e-3, "{small:?}");
}

/// Rows of an independent table of homogeneous states, computed with 30-digit arithmetic (fat, nu 0.45; C10 4.7105788, C01
/// 1.1776447, K 113.838987667 kPa): the lateral stretch leaves the sides stress-free, `P11` and `P22` are nominal stresses in
/// kPa.
#[test]
fn homogeneous_states_agree_with_an_independent_table() {
    let m = Material {
        isochoric: Isochoric::MooneyRivlin { c10: 4.7105788, c01: 1.1776447 },
        bulk: 113.838987667,
        volumetric: Volumetric::Quadratic,
    };
    let rows = [
        ([0.7, 1.1740087642117, 1.1740087642117], -16.565470766958, 0.0, 0.0),
        ([1.6346473814667, 0.7, 0.7], 0.0, -38.887247324874, -38.887247324874),
        ([0.7, 1.0, 1.319772395047], -22.442496211724, -8.3190722857326, 0.0),
        ([0.7, 1.0, 1.0], -41.79664711173, -21.230454625895, -21.230454625895),
        ([1.05, 0.97830171029292, 0.97830171029292], 1.6107347849214, 0.0, 0.0),
        ([1.05, 1.0, 0.96072471211164], 1.999306704668, 0.91895308044216, 0.0),
    ];
    for (stretch, p1, p2, p3) in rows {
        let p = m.first_piola(&Matrix3::from_diagonal(&stretch.into())).unwrap();
        let expected = Matrix3::from_diagonal(&[p1, p2, p3].into());
        assert!((p - expected).norm() < 1e-8 * expected.norm(), "{stretch:?}: {p}");
    }
    // Simple shear of 1/2: P12, then the Cauchy stresses 11, 22, 33.
    let shear = Matrix3::new(1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let p = m.first_piola(&shear).unwrap();
    assert!((p[(0, 1)] - 5.8882235).abs() < 1e-8 * 5.9);
    let cauchy = p * shear.transpose();
    for (i, expected) in [1.76646705, -1.1776447, -0.58882235].into_iter().enumerate() {
        assert!((cauchy[(i, i)] - expected).abs() < 1e-8 * 5.9);
    }
    // Neo-Hookean skin.
    let m = Material {
        isochoric: Isochoric::MooneyRivlin { c10: 35.0714615, c01: 0.0 },
        bulk: 678.048255667,
        volumetric: Volumetric::Quadratic,
    };
    let p = m.first_piola(&Matrix3::from_diagonal(&[0.7, 1.1756426109909, 1.1756426109909].into())).unwrap();
    assert!((p - Matrix3::from_diagonal(&[-91.386956342544, 0.0, 0.0].into())).norm() < 1e-8 * 91.4);
}
