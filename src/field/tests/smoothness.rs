use super::shapes::{Random, block, filtered, sphere};
use crate::{DistanceField, FieldSettings};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, Vector};

fn fields() -> Vec<DistanceField> {
    let settings = FieldSettings { spacing_mm: 0.5, band_mm: 1.0, margin_mm: 4.0 };
    [
        sphere(Point::origin(), 8.0, 4),
        block(Point::new(0.3, 0.2, 0.1), Vector::new(8.0, 5.0, 3.0)),
        filtered(&sphere(Point::origin(), 7.0, 3), |_, c| c[0].z < 1.0),
    ]
    .iter()
    .map(|mesh| DistanceField::build(mesh, &settings, &Control::new()).unwrap().0)
    .collect()
}

#[test]
fn value_and_gradient_are_the_same_on_both_sides_of_cells_and_bricks() {
    for field in fields() {
        let domain = field.domain();
        let (h, mut random) = (field.spacing_mm(), Random(10));
        for n in 0..6000 {
            let mut p = random.point(domain.center(), 10.0);
            let axis = n % 3;
            // The point lies on a face between cells, every second one on a face between bricks.
            let step = if n % 2 == 0 { 8.0 * h } else { h };
            p[axis] = domain.min[axis] + ((p[axis] - domain.min[axis]) / step).round() * step;
            // Beyond the domain the field is only continuous.
            if !domain.grown(-0.1).contains(&p) {
                continue;
            }
            let mut offset = Vector::zeros();
            offset[axis] = 1e-9;
            let (v0, g0, h0) = field.value_gradient_hessian(&(p - offset));
            let (v1, g1, h1) = field.value_gradient_hessian(&(p + offset));
            // The derivatives explain this much of the change over 2e-9 mm; the rest is round-off.
            assert!((v1 - v0 - 1e-9 * (g0 + g1)[axis]).abs() < 1e-12, "{p}: {v0} {v1} {g0} {g1}");
            assert!((g1 - g0).norm() < 2e-9 * (h0.norm() + h1.norm()) + 1e-11, "{p}: {g0} {g1}");
        }
    }
}

#[test]
fn gradient_and_hessian_are_the_derivatives_of_the_value_inside_and_beyond_the_domain() {
    for field in fields() {
        let mut random = Random(11);
        for n in 0..3000 {
            let p = random.point(field.domain().center(), if n % 2 == 0 { 9.0 } else { 40.0 });
            let (value, gradient, hessian) = field.value_gradient_hessian(&p);
            assert!((field.value(&p) - value).abs() < 1e-12);
            let same = field.value_gradient(&p);
            assert!((same.0 - value).abs() < 1e-12 && (same.1 - gradient).norm() < 1e-12);
            let step = 1e-6;
            let mut crosses = false;
            let mut worst = (0.0f64, 0.0f64);
            for a in 0..3 {
                let mut e = Vector::zeros();
                e[a] = step;
                let (v0, g0, h0) = field.value_gradient_hessian(&(p - e));
                let (v1, g1, h1) = field.value_gradient_hessian(&(p + e));
                worst.0 = worst.0.max(((v1 - v0) / (2.0 * step) - gradient[a]).abs());
                worst.1 = worst.1.max(((g1 - g0) / (2.0 * step) - hessian.column(a)).norm());
                // Across a face between cells the second derivative jumps.
                crosses |= (h1 - h0).norm() > 1e-3;
            }
            // Round-off is 1e-15 times 40 mm over 2e-6; the third derivative (about 10 / h²) adds its product with the squared
            // step.
            assert!(worst.0 < 1e-6, "{p} {worst:?}");
            assert!(crosses || worst.1 < 1e-5, "{p} {worst:?}");
        }
    }
}

#[test]
fn far_away_the_value_is_finite_continuous_and_grows() {
    for field in fields() {
        let mut random = Random(12);
        for _ in 0..200 {
            let direction = (random.point(Point::origin(), 1.0) - Point::origin()).normalize();
            let mut last = field.value(&(field.domain().center() + direction * 30.0));
            for step in 1..200 {
                let p = field.domain().center() + direction * (30.0 + 50.0 * f64::from(step));
                let (value, gradient) = field.value_gradient(&p);
                assert!(value > last && value.is_finite() && gradient.iter().all(|g| g.is_finite()));
                last = value;
            }
        }
        let corner = field.domain().max;
        let outside = corner + Vector::repeat(1e-9);
        assert!((field.value(&corner) - field.value(&outside)).abs() < 1e-8);
        let far = Point::new(1e300, -1e4, 0.0);
        assert!(field.value_gradient(&far).1.iter().all(|g| g.is_finite()));
    }
}

#[test]
fn vectors_of_the_processor_give_the_bits_of_plain_arithmetic() {
    for mut field in fields() {
        let mut random = Random(12);
        let points: Vec<Point> = (0..4000).map(|_| random.point(field.domain().center(), 11.0)).collect();
        let all = |field: &DistanceField| -> Vec<_> {
            points.iter().map(|p| (field.value_gradient_hessian(p), field.value_gradient(p), field.value(p))).collect()
        };
        let with_vectors = all(&field);
        field.without_vectors();
        assert_eq!(all(&field), with_vectors);
        // All queries evaluate the same polynomial.
        assert!(with_vectors.iter().all(|((v, g, _), (v1, g1), v2)| v == v1 && g == g1 && v == v2));
    }
}
