use super::shapes::{Random, block, block_distance, joined, sphere};
use crate::{DistanceField, ExactDistance, FieldError, FieldReport, FieldSettings};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

fn built(mesh: &TriMesh, spacing_mm: f64, band_mm: f64) -> (DistanceField, FieldReport) {
    let settings = FieldSettings { spacing_mm, band_mm, margin_mm: 6.0 };
    DistanceField::build(mesh, &settings, &Control::new()).unwrap()
}

#[test]
fn exact_distances_and_winding_numbers_agree_with_brute_force() {
    let mesh =
        joined(&sphere(Point::new(1.0, 2.0, 3.0), 10.0, 3), &block(Point::origin(), Vector::new(3.0, 2.0, 14.0)));
    let exact = ExactDistance::new(&mesh);
    let mut random = Random(1);
    for _ in 0..300 {
        let p = random.point(Point::origin(), 25.0);
        let mut nearest = f64::INFINITY;
        let mut angle = 0.0;
        for t in 0..mesh.triangles().len() {
            let corners = mesh.corners(t);
            nearest = nearest.min((crate::triangle::closest_point(&p, &corners) - p).norm());
            angle += crate::triangle::solid_angle(&p, &corners);
        }
        let (point, triangle, distance) = exact.closest(&p);
        assert!((distance - nearest).abs() < 1e-12 && ((point - p).norm() - nearest).abs() < 1e-12);
        let again = crate::triangle::closest_point(&p, &mesh.corners(triangle));
        assert!((again - point).norm() < 1e-12);
        let winding = angle / (4.0 * std::f64::consts::PI);
        assert!((exact.winding_number(&p) - winding).abs() < 0.03, "{} {winding}", exact.winding_number(&p));
    }
}

#[test]
fn a_sphere_far_from_the_origin_has_its_closed_form() {
    // A faceted sphere lies up to r (1 - cos 1.1°) = 0.004 mm inside the round one. The error of the spline is h² times the
    // change of curvature.
    for center in [Point::origin(), Point::new(1e5, -1e5, 1e5)] {
        let (field, report) = built(&sphere(center, 20.0, 5), 0.8, 3.0);
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        assert!(report.max_error_mm < 0.01 && report.checked_points > 3000, "{report:?}");
        let mut random = Random(2);
        for _ in 0..2000 {
            let direction = (random.point(Point::origin(), 1.0) - Point::origin()).normalize();
            let d = 6.0 * random.unit() - 3.0;
            let (value, gradient) = field.value_gradient(&(center + direction * (20.0 + d)));
            assert!((value - d).abs() < 0.01, "{value} for {d}");
            assert!((gradient - direction).norm() < 0.06);
        }
        // Beyond the band the coarse spline still gives depth and direction.
        let (value, gradient) = field.value_gradient(&(center + Vector::new(8.0, 1.0, -2.0)));
        assert!((value + 20.0 - 69f64.sqrt()).abs() < 1.0 && gradient.normalize().x > 0.8, "{value} {gradient}");
    }
}

#[test]
fn a_box_is_sharp_to_a_fraction_of_the_spacing() {
    let (center, half) = (Point::new(0.3, 0.2, -0.1), Vector::new(9.0, 6.0, 4.0));
    let (field, report) = built(&block(center, half), 0.5, 3.0);
    let mut random = Random(3);
    let (mut max, mut sum, mut n) = (0.0f64, 0.0, 0.0);
    while n < 5000.0 {
        let p = random.point(center, 13.0);
        let d = block_distance(center, half, &p);
        if d.abs() < 3.0 {
            let error = field.value(&p) - d;
            max = max.max(error.abs());
            sum += error * error;
            n += 1.0;
        }
    }
    // Next to an edge no C1 function of this spacing is more accurate than about 0.1 h.
    assert!(max < 0.12 && (sum / n).sqrt() < 0.012, "{max} {}", (sum / n).sqrt());
    // Two thirds of the report's points lie on edges and on the medial axis, where the error is largest.
    assert!(report.max_error_mm < 0.2 && report.rms_error_mm < 0.06, "{report:?}");
}

#[test]
fn the_error_of_a_sphere_falls_with_the_third_power_of_the_spacing_near_the_surface() {
    // The sphere is small enough that the spline's error exceeds the rounding of its coefficients.
    let mesh = sphere(Point::origin(), 5.0, 6);
    let exact = ExactDistance::new(&mesh);
    let rms = [1.6, 0.8].map(|spacing| {
        let (field, _) = built(&mesh, spacing, 2.0);
        let mut random = Random(4);
        let mut sum = 0.0;
        for _ in 0..2000 {
            let direction = (random.point(Point::origin(), 1.0) - Point::origin()).normalize();
            let p = Point::origin() + direction * (5.0 + 3.0 * random.unit() - 1.5);
            sum += (field.value(&p) - exact.signed(&p)).powi(2);
        }
        (sum / 2000.0).sqrt()
    });
    assert!(rms[0] / rms[1] > 5.0, "{rms:?}");
}

#[test]
fn settings_out_of_range_too_many_samples_and_cancellation_are_refused() {
    let mesh = sphere(Point::origin(), 10.0, 1);
    let control = Control::new();
    let with = |spacing_mm, band_mm, margin_mm| {
        DistanceField::build(&mesh, &FieldSettings { spacing_mm, band_mm, margin_mm }, &control).map(|_| ())
    };
    assert!(matches!(with(0.0, 5.0, 10.0), Err(FieldError::Setting { name: "spacing_mm", .. })));
    assert!(matches!(with(f64::NAN, 5.0, 10.0), Err(FieldError::Setting { name: "spacing_mm", .. })));
    assert!(matches!(with(1.0, -1.0, 10.0), Err(FieldError::Setting { name: "band_mm", .. })));
    assert!(matches!(with(1.0, 5.0, f64::INFINITY), Err(FieldError::Setting { name: "margin_mm", .. })));
    assert!(matches!(with(0.01, 5.0, 1000.0), Err(FieldError::TooLarge { .. })));
    let cancelled = Control::new();
    cancelled.cancel();
    let settings = FieldSettings::default();
    assert!(matches!(DistanceField::build(&mesh, &settings, &cancelled), Err(FieldError::Cancelled(_))));
}
