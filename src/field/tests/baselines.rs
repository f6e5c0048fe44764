use super::shapes::{Random, block, block_distance, filtered, flipped, joined, sphere, torus};
use crate::{
    ExactDistance, FieldError, FieldSettings, Method, MethodSettings, Octree, Resolution, SampledReport,
    SampledSettings, SignedField, Tolerance, UniformField,
};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector};

/// The fields of all published methods, with their names and reports.
fn built(mesh: &TriMesh, settings: &SampledSettings) -> Vec<(&'static str, Box<dyn Implicit>, SampledReport)> {
    let control = Control::new();
    let uniform = UniformField::build(mesh, settings, &control).unwrap();
    let hybrid = Octree::hybrid(mesh, settings, &control).unwrap();
    let frisken = Octree::frisken(mesh, settings, &control).unwrap();
    vec![
        ("uniform", Box::new(uniform.0), uniform.1),
        ("hybrid", Box::new(hybrid.0), hybrid.1),
        ("frisken", Box::new(frisken.0), frisken.1),
    ]
}

fn settings(spacing_mm: f64, tolerance_mm: f64) -> SampledSettings {
    SampledSettings {
        resolution: Resolution::SpacingMm(spacing_mm),
        tolerance: Tolerance::Mm(tolerance_mm),
        band_mm: 3.0,
        margin_mm: 4.0,
    }
}

/// Largest difference from `distance` at random points of the band; checks the sign off the surface.
fn largest_error(name: &str, field: &dyn Implicit, center: Point, half: f64, distance: impl Fn(&Point) -> f64) -> f64 {
    let mut random = Random(3);
    let (mut largest, mut near) = (0.0f64, 0);
    for _ in 0..6000 {
        let p = random.point(center, half);
        let d = distance(&p);
        let value = field.value(&p);
        assert!(value.is_finite());
        assert!(d.abs() < 0.3 || (d < 0.0) == (value < 0.0), "{name}: {value} instead of {d} at {p}");
        if d.abs() <= 3.0 {
            largest = largest.max((value - d).abs());
            near += 1;
        }
    }
    assert!(near > 300, "{near}");
    largest
}

#[test]
fn sphere_box_and_torus_have_their_closed_forms() {
    let center = Point::new(1e3, -2e3, 5e2);
    // Trilinear interpolation of a function of curvature 1/r is off by at most 3 h²/8r: 0.012 mm at 10 mm for h = 0.58, and
    // 0.05 mm at the inner side of the band. The facets and the tolerance add 0.02 mm.
    let mesh = sphere(center, 10.0, 4);
    for (name, field, report) in built(&mesh, &settings(0.58, 0.01)) {
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        let error = largest_error(name, field.as_ref(), center, 14.0, |p| (p - center).norm() - 10.0);
        assert!(error < 0.06, "{name}: {error}");
    }
    // At edges the gradient jumps by √2. The error stays below half a cell's diagonal times that; it reaches h/2.
    let half = Vector::new(9.0, 6.0, 4.0);
    let mesh = block(center, half);
    for (name, field, _) in built(&mesh, &settings(0.58, 0.01)) {
        let error = largest_error(name, field.as_ref(), center, 12.0, |p| block_distance(center, half, p));
        assert!(error < 0.5 * 0.58, "{name}: {error}");
    }
    let mesh = torus(center, 9.0, 3.5, 96);
    for (name, field, _) in built(&mesh, &settings(0.58, 0.01)) {
        let error = largest_error(name, field.as_ref(), center, 13.0, |p| {
            let q = p - center;
            (q.xy().norm() - 9.0).hypot(q.z) - 3.5
        });
        // At the core circle the distance has a cone's tip: the error is up to half a diagonal, √3 h / 2, times the slope.
        assert!(error < 0.87 * 0.58, "{name}: {error}");
    }
}

#[test]
fn samples_agree_with_the_exact_distance() {
    // With a tolerance of nearly zero a value near a node is that of the node, whose distance is exact.
    let mesh = joined(&sphere(Point::origin(), 8.0, 3), &block(Point::new(14.0, 0.0, 0.0), Vector::new(3.0, 2.0, 5.0)));
    let exact = ExactDistance::new(&mesh);
    let s = settings(0.7, 1e-4);
    for (name, field, report) in built(&mesh, &s) {
        let bounds = mesh.bounds().grown(s.margin_mm);
        let edge = report.spacing_mm * report.resolution as f64;
        let first = bounds.center() - Vector::repeat(0.5 * edge);
        let shift = if name == "uniform" { 0.5 } else { 0.0 };
        let mut checked = 0;
        for n in 0..report.resolution.pow(3) {
            let at = [n % report.resolution, n / report.resolution % report.resolution, n / report.resolution.pow(2)];
            let p = first + Vector::from(at.map(|a| a as f64 + shift)) * report.spacing_mm;
            let d = exact.signed(&p);
            if d.abs() < 3.0 {
                assert!((field.value(&p) - d).abs() < 5e-4, "{name}: {} instead of {d} at {p}", field.value(&p));
                checked += 1;
            }
        }
        assert!(checked > 3000);
    }
}

#[test]
fn a_smaller_tolerance_or_spacing_never_costs_less_and_an_octree_costs_less_than_the_grid() {
    let mesh = sphere(Point::origin(), 12.0, 4);
    let control = Control::new();
    for build in [Octree::hybrid, Octree::frisken] {
        let bytes = |h, t| build(&mesh, &settings(h, t), &control).unwrap().1.bytes;
        assert!(bytes(0.5, 0.1) < bytes(0.5, 0.001));
        assert!(bytes(1.0, 0.001) < bytes(0.5, 0.001));
        let grid = UniformField::build(&mesh, &settings(0.5, 0.001), &control).unwrap().1.bytes;
        assert!(bytes(0.5, 0.001) < grid / 2);
    }
}

#[test]
fn deep_and_far_points_are_finite_and_lead_out() {
    let mesh = sphere(Point::new(2.0, 0.0, 0.0), 25.0, 4);
    for (name, field, _) in built(&mesh, &settings(1.0, 0.05)) {
        // Along a ray from deep inside to far outside the value must grow at every step.
        let mut last = f64::NEG_INFINITY;
        for step in 1..60 {
            let p = Point::new(2.0 + 2.0 * f64::from(step), 0.3, -0.2);
            let (value, gradient) = field.value_gradient(&p);
            assert!(value > last && gradient.x > 0.3, "{name}: {value} after {last} at {p}, {gradient}");
            last = value;
        }
        for p in [Point::new(1e150, -3.0, 0.0), Point::new(-4e4, 1e9, 2.0)] {
            let (value, gradient) = field.value_gradient(&p);
            assert!(value.is_finite() && gradient.iter().all(|g| g.is_finite()), "{name}");
        }
    }
}

#[test]
fn the_gradient_is_the_derivative_of_the_value() {
    let mesh = joined(&sphere(Point::origin(), 8.0, 3), &block(Point::new(7.0, 0.0, 0.0), Vector::new(6.0, 2.0, 2.0)));
    for (name, field, _) in built(&mesh, &settings(0.9, 0.02)) {
        let mut random = Random(8);
        let mut wrong = 0;
        for _ in 0..500 {
            let p = random.point(Point::new(3.0, 0.0, 0.0), 20.0);
            let gradient = field.value_gradient(&p).1;
            for a in 0..3 {
                let step = Vector::ith(a, 1e-5);
                let slope = (field.value(&(p + step)) - field.value(&(p - step))) / 2e-5;
                wrong += usize::from((slope - gradient[a]).abs() > 1e-4);
            }
        }
        // A finite difference across a face between cells is not a derivative.
        assert!(wrong <= 2, "{name}: {wrong}");
    }
}

#[test]
fn a_rigid_motion_of_the_query_is_one_of_the_mesh() {
    let mesh = torus(Point::origin(), 9.0, 3.5, 48);
    let motion = Motion::new(Vector::new(30.0, -12.0, 5.0), Vector::new(0.4, -0.7, 0.2));
    let fixed = built(&mesh, &settings(0.5, 0.01));
    let moved = built(&mesh.moved(&motion), &settings(0.5, 0.01));
    for ((name, fixed, _), (_, moved, _)) in fixed.iter().zip(&moved) {
        let mut random = Random(4);
        for _ in 0..1000 {
            let p = random.point(Point::origin(), 13.0);
            let d = ((p.coords.xy().norm() - 9.0).hypot(p.z) - 3.5).abs();
            // The two grids differ by at most twice the error of one.
            if d < 2.5 {
                assert!((fixed.value(&p) - moved.value(&(motion * p))).abs() < 0.12, "{name} at {p}");
            }
        }
    }
}

#[test]
fn the_same_bits_come_from_any_number_of_threads() {
    let mesh =
        joined(&sphere(Point::origin(), 9.0, 3), &flipped(&sphere(Point::new(6.0, 1.0, 0.0), 5.0, 3), |t| t % 7 == 0));
    let bits = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut bits = Vec::new();
            for (_, field, report) in built(&mesh, &settings(0.6, 0.01)) {
                let mut random = Random(5);
                bits.push(report.bytes as u64);
                bits.extend((0..3000).map(|_| field.value(&random.point(Point::origin(), 20.0)).to_bits()));
            }
            bits
        })
    };
    let one = bits(1);
    assert_eq!(one, bits(2));
    assert_eq!(one, bits(3));
}

#[test]
fn broken_surfaces_give_finite_fields() {
    let p = |x: f64, y: f64, z: f64| Point::new(x, y, z);
    let one = |corners: [Point; 3]| TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
    let ball = sphere(Point::origin(), 6.0, 2);
    let surfaces = [
        ("triangle", one([p(0.0, 0.0, 0.0), p(5.0, 0.0, 0.0), p(0.0, 4.0, 1.0)])),
        ("point", one([p(3.0, 2.0, 1.0); 3])),
        ("segment", one([p(0.0, 0.0, 0.0), p(1.0, 2.0, 3.0), p(2.0, 4.0, 6.0)])),
        ("needle", one([p(0.0, 0.0, 0.0), p(10.0, 0.0, 0.0), p(5.0, 1e-3, 0.0)])),
        ("tiny", one([p(0.0, 0.0, 0.0), p(1e-25, 0.0, 0.0), p(0.0, 1e-25, 0.0)])),
        ("far away", one([p(1e6, 1e6, 1e6), p(1e6 + 3.0, 1e6, 1e6), p(1e6, 1e6 + 3.0, 1e6)])),
        ("large", one([p(-1e6, 0.0, 0.0), p(1e6, 0.0, 5.0), p(0.0, 1e6, 0.0)])),
        ("open", filtered(&ball, |t, _| t > 20)),
        ("doubled", joined(&ball, &ball)),
        ("cancelled", joined(&ball, &flipped(&ball, |_| true))),
        ("mixed", flipped(&ball, |t| t % 3 == 0)),
    ];
    for (what, mesh) in &surfaces {
        let s = SampledSettings { resolution: Resolution::Cells(24), ..settings(1.0, 0.05) };
        for (name, field, report) in built(mesh, &s) {
            let bounds = mesh.bounds().grown(10.0);
            let mut random = Random(6);
            let half = 0.5 * (bounds.max - bounds.min).max();
            for _ in 0..500 {
                let at = random.point(bounds.center(), half);
                let (value, gradient) = field.value_gradient(&at);
                assert!(value.is_finite() && gradient.iter().all(|g| g.is_finite()), "{name} of {what} at {at}");
                let exact = (ExactDistance::new(mesh).closest(&at).2 - value.abs()).abs();
                // Far from the band values are interpolated between every eighth node: the error is up to half a diagonal, 7 h.
                let is_inside = mesh.bounds().grown(4.0).contains(&at);
                assert!(!is_inside || exact < 7.0 * report.spacing_mm, "{name} of {what}: {exact} at {at}");
            }
        }
    }
    assert!(built(&surfaces[8].1, &settings(1.0, 0.05))[0].2.warnings.iter().any(|w| w.code == "sign-at-duplicates"));
    assert!(built(&surfaces[7].1, &settings(1.0, 0.05))[1].2.warnings.iter().any(|w| w.code == "sign-at-open-edges"));
}

#[test]
fn settings_out_of_range_too_much_memory_and_cancellation_are_refused() {
    let mesh = sphere(Point::origin(), 50.0, 1);
    let refused = |s: SampledSettings| {
        [
            UniformField::build(&mesh, &s, &Control::new()).map(|_| ()),
            Octree::hybrid(&mesh, &s, &Control::new()).map(|_| ()),
            Octree::frisken(&mesh, &s, &Control::new()).map(|_| ()),
        ]
    };
    let good = settings(1.0, 0.01);
    for found in refused(SampledSettings { resolution: Resolution::SpacingMm(0.02), ..good }) {
        assert!(matches!(found, Err(FieldError::TooLarge { .. })), "{found:?}");
    }
    for found in refused(SampledSettings { resolution: Resolution::Cells(4), ..good }) {
        assert!(matches!(found, Err(FieldError::Setting { name: "resolution", .. })), "{found:?}");
    }
    for found in refused(SampledSettings { tolerance: Tolerance::Relative(f64::NAN), ..good }) {
        assert!(matches!(found, Err(FieldError::Setting { name: "tolerance", .. })), "{found:?}");
    }
    let huge = mesh.moved(&Motion::translation(1e300, 0.0, 0.0));
    let found = UniformField::build(&huge, &good, &Control::new()).map(|_| ());
    assert!(matches!(found, Err(FieldError::Setting { name: "largest coordinate", .. })), "{found:?}");
    let cancelled = Control::new();
    cancelled.cancel();
    assert!(matches!(UniformField::build(&mesh, &good, &cancelled), Err(FieldError::Cancelled(_))));
    assert!(matches!(Octree::hybrid(&mesh, &good, &cancelled), Err(FieldError::Cancelled(_))));
    assert!(matches!(Octree::frisken(&mesh, &good, &cancelled), Err(FieldError::Cancelled(_))));
}

#[test]
fn one_type_holds_a_field_of_any_method_and_reports_its_error() {
    let mesh = sphere(Point::new(1.0, 2.0, 3.0), 10.0, 4);
    for method in Method::ALL {
        let field = FieldSettings { spacing_mm: 0.8, band_mm: 3.0, margin_mm: 4.0 };
        let s = MethodSettings { method, field, resolution: None, tolerance: Tolerance::Mm(0.01) };
        let (field, report) = SignedField::build(&mesh, &s, &Control::new()).unwrap();
        assert!(report.max_error_mm < 0.15 && report.max_error_mm > 0.0, "{method:?}: {report:?}");
        assert!(report.bytes == field.bytes() && report.checked_points > 3000);
        assert!(field.domain().contains(&Point::new(-9.0, 2.0, 3.0)));
        // A query in the segment's frame gives the field of the moved segment.
        let motion = Motion::translation(5.0, 0.0, 0.0);
        let p = Point::new(18.0, 2.0, 3.0);
        assert!((field.value(&motion.inverse_transform_point(&p)) - 2.0).abs() < 0.1);
        let finer = SignedField::build_only(&mesh, &MethodSettings { resolution: Some(64), ..s }, &Control::new());
        assert!(finer.unwrap().0.bytes() > report.bytes, "{method:?}");
    }
}
