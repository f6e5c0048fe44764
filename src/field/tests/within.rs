use super::shapes::{Random, block, sphere, torus};
use crate::{DistanceField, ExactDistance, FieldError, FieldSettings};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Implicit, Point, Vector};

const SETTINGS: FieldSettings = FieldSettings { spacing_mm: 0.5, band_mm: 2.0, margin_mm: 4.0 };

fn corner() -> Aabb {
    Aabb { min: Point::new(2.0, -20.0, -20.0), max: Point::new(20.0, 20.0, 20.0) }
}

#[test]
fn in_the_box_the_field_is_that_of_the_whole_and_elsewhere_it_is_coarse_small_and_reported() {
    let mesh = torus(Point::origin(), 9.0, 4.0, 64);
    let exact = ExactDistance::new(&mesh);
    let control = Control::new();
    let (whole, warnings) = DistanceField::build_unmeasured(&exact, &mesh, &SETTINGS, &control).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let (part, warnings) = DistanceField::build_within(&exact, &mesh, Some(&corner()), &SETTINGS, &control).unwrap();
    assert!(warnings.len() == 1 && warnings[0].code == "partial-field", "{warnings:?}");
    assert!(part.bytes() < 2 * whole.bytes() / 3, "{} {}", part.bytes(), whole.bytes());
    let mut random = Random(80);
    let (mut fine, mut coarse) = (0, 0);
    for _ in 0..20_000 {
        let p = random.point(Point::origin(), 14.0);
        let (value, gradient) = part.value_gradient(&p);
        assert!(value.is_finite() && gradient.norm() < 3.0);
        let d = exact.signed(&p);
        // Missing bricks influence points only as far as the fit's sweeps carry: two of three nodes, and two of three half ones.
        if corner().grown(-7.0).contains(&p) {
            assert_eq!(part.value_gradient(&p), whole.value_gradient(&p));
            assert_eq!(part.is_fine_at(&p), whole.is_fine_at(&p));
            fine += 1;
        } else if !part.is_fine_at(&p) {
            // The tube of 4 mm is sampled on a lattice of 4 mm.
            assert!((value - d).abs() < 2.0, "{p}: {value} {d}");
            assert!(d.abs() < 2.0 || (value < 0.0) == (d < 0.0), "{p}: {value} {d}");
            coarse += 1;
        }
    }
    assert!(fine > 2000 && coarse > 2000, "{fine} {coarse}");
}

#[test]
fn the_field_is_smooth_across_the_border_of_the_box() {
    let mesh = block(Point::origin(), Vector::new(8.0, 5.0, 3.0));
    let exact = ExactDistance::new(&mesh);
    let (field, _) = DistanceField::build_within(&exact, &mesh, Some(&corner()), &SETTINGS, &Control::new()).unwrap();
    let mut random = Random(81);
    for n in 0..20_000 {
        let mut p = random.point(Point::origin(), 9.0);
        let axis = n % 3;
        // The point lies on a face between bricks.
        let domain = field.domain();
        p[axis] = domain.min[axis] + ((p[axis] - domain.min[axis]) / 4.0).round() * 4.0;
        if !domain.grown(-0.1).contains(&p) {
            continue;
        }
        let offset = Vector::ith(axis, 1e-9);
        let (v0, g0, h0) = field.value_gradient_hessian(&(p - offset));
        let (v1, g1, h1) = field.value_gradient_hessian(&(p + offset));
        // The derivatives explain this much of the change over 2e-9 mm; the rest is round-off.
        assert!((v1 - v0 - 1e-9 * (g0 + g1)[axis]).abs() < 1e-12, "{p}: {v0} {v1}");
        assert!((g1 - g0).norm() < 2e-9 * (h0.norm() + h1.norm()) + 1e-11, "{p}: {g0} {g1}");
    }
}

#[test]
fn a_box_elsewhere_is_refused() {
    let mesh = sphere(Point::origin(), 5.0, 2);
    let exact = ExactDistance::new(&mesh);
    for far in [Point::new(100.0, 0.0, 0.0), Point::new(f64::NAN, 0.0, 0.0)] {
        let within = Aabb { min: far, max: far + Vector::repeat(1.0) };
        let built = DistanceField::build_within(&exact, &mesh, Some(&within), &SETTINGS, &Control::new());
        assert!(matches!(built, Err(FieldError::BoxOutsideDomain)));
    }
}
