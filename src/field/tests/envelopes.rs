use super::shapes::{Random, block, block_distance, filtered, flipped, joined, sphere};
use crate::{Envelope, EnvelopeSettings, FieldError, FieldSettings, envelope};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, Severity, TopologyFaults, TriMesh, Vector};

fn closed(mesh: &TriMesh, closing_mm: f64, min_visibility: f64) -> Envelope {
    let settings = EnvelopeSettings { spacing_mm: 1.0, closing_mm, min_visibility };
    let found = envelope(mesh, &settings, &Control::new()).unwrap();
    assert!(TopologyFaults::of(&found.surface).is_closed_manifold());
    let [nx, ny, _] = found.grid.dims;
    for (n, value) in found.grid.values.iter().enumerate() {
        let at = [n % nx, n / nx % ny, n / (nx * ny)];
        let is_border = (0..3).any(|a| at[a] == 0 || at[a] + 1 == found.grid.dims[a]);
        assert!(value.is_finite() && (!is_border || *value > 0.0));
    }
    found
}

/// Two spheres 2 mm apart, the inner one a cavity, with a hole of radius `hole` at the top of both.
fn hollow_ball(hole: f64) -> TriMesh {
    let keep = |_: usize, c: [Point; 3]| c.iter().any(|p| p.z < 0.0 || p.x.hypot(p.y) > hole);
    let outer = filtered(&sphere(Point::origin(), 16.0, 4), keep);
    let inner = filtered(&flipped(&sphere(Point::origin(), 14.0, 4), |_| true), keep);
    joined(&outer, &inner)
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)
}

#[test]
fn openly_facing_bone_keeps_its_exact_distance() {
    let (center, half) = (Point::new(0.2, -0.3, 0.4), Vector::new(12.0, 8.0, 6.0));
    let found = closed(&block(center, half), 2.0, 0.06);
    let mut near = 0;
    for n in 0..found.grid.values.len() {
        let [nx, ny, _] = found.grid.dims;
        let p = found.grid.position(n % nx, n / nx % ny, n / (nx * ny));
        let d = block_distance(center, half, &p);
        let value = f64::from(found.grid.values[n]);
        if (-1.0..4.0).contains(&d) {
            assert!((value - d).abs() < 1e-5, "{value} {d} at {p}");
            near += 1;
        }
        assert!(d.abs() < 1e-5 || (value < 0.0) == (d < 0.0));
    }
    assert!(near > 5000);
}

#[test]
fn a_cavity_with_a_narrow_opening_is_filled_and_reported() {
    // Radius 1.5 mm is below the closing radius. The rim is open between the two spheres; the winding number closes it.
    let found = closed(&hollow_ball(1.5), 2.0, 0.0);
    let volume = found.surface.volume();
    assert!((volume / ball_volume(16.0) - 1.0).abs() < 0.02, "{volume}");
    assert!(found.warnings.iter().any(|w| w.code == "open-surface"), "{:?}", found.warnings);
    // The same ball without a hole gives the filled volume.
    let shell = joined(&sphere(Point::origin(), 16.0, 4), &flipped(&sphere(Point::origin(), 14.0, 4), |_| true));
    let found = closed(&shell, 2.0, 0.0);
    assert!(found.warnings.iter().any(|w| w.code == "cavities-filled"), "{:?}", found.warnings);
    assert!((found.surface.volume() / ball_volume(16.0) - 1.0).abs() < 0.01);
}

#[test]
fn a_wide_opening_stays_open_unless_what_lies_behind_sees_too_little_of_the_outside() {
    let cup = hollow_ball(6.0);
    let open = closed(&cup, 2.0, 0.0);
    let shell = ball_volume(16.0) - ball_volume(14.0);
    assert!(open.surface.volume() < 1.3 * shell, "{} {shell}", open.surface.volume());
    // The middle sees (1 - cos 24°) / 2 = 4 % of all directions.
    let filled = closed(&cup, 2.0, 0.06);
    assert!(filled.grid.sample(&Point::origin()) < 0.0);
    assert!(filled.surface.volume() > 0.9 * ball_volume(16.0), "{}", filled.surface.volume());
    // The default settings fill it too: a sinus behind a wall with a hole must not count as tissue.
    let usual = envelope(&cup, &EnvelopeSettings::default(), &Control::new()).unwrap();
    assert!(usual.grid.sample(&Point::origin()) < 0.0);
}

#[test]
fn a_narrow_groove_is_filled_a_wide_one_is_not() {
    let base = block(Point::new(0.0, 0.0, -8.0), Vector::new(20.0, 10.0, 4.0));
    let ridge = |x: f64, half: f64| block(Point::new(x, 0.0, -1.0), Vector::new(half, 10.0, 5.0));
    // Grooves from -13 to -10 (3 mm wide) and from -4 to 6 (10 mm wide), 8 mm deep.
    let mesh = [ridge(-16.5, 3.5), ridge(-7.0, 3.0), ridge(13.0, 7.0)].iter().fold(base, |sum, r| joined(&sum, r));
    for min_visibility in [0.0, 0.06] {
        let found = closed(&mesh, 2.0, min_visibility);
        assert!(found.grid.sample(&Point::new(-11.5, 0.0, 1.0)) < 0.0);
        assert!(found.grid.sample(&Point::new(-11.5, 0.0, 5.0)) > 0.0);
        let middle = found.grid.sample(&Point::new(1.0, 0.0, 0.0));
        assert!((middle - 4.0).abs() < 0.1, "{middle}");
    }
}

#[test]
fn small_parts_are_dropped_and_other_separate_parts_stay() {
    let mesh = joined(
        &joined(&sphere(Point::origin(), 12.0, 3), &sphere(Point::new(20.0, 0.0, 0.0), 2.5, 2)),
        &sphere(Point::new(0.0, 25.0, 0.0), 8.0, 3),
    );
    let found = closed(&mesh, 2.0, 0.06);
    assert!(found.grid.sample(&Point::new(20.0, 0.0, 0.0)) > 0.0);
    assert!(found.grid.sample(&Point::new(0.0, 25.0, 0.0)) < 0.0);
    assert!(
        found.warnings.iter().any(|w| w.code == "envelope-parts-dropped" && w.severity == Severity::Info),
        "{:?}",
        found.warnings
    );
}

#[test]
fn the_envelope_has_a_field_of_its_own() {
    let found = closed(&sphere(Point::new(1.0, 2.0, 3.0), 12.0, 4), 2.0, 0.06);
    let settings = FieldSettings { spacing_mm: 1.0, band_mm: 3.0, margin_mm: 5.0 };
    let (field, report) = found.field(&settings, &Control::new()).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let mut random = Random(13);
    for _ in 0..500 {
        let p = random.point(Point::new(1.0, 2.0, 3.0), 14.0);
        let d = (p - Point::new(1.0, 2.0, 3.0)).norm() - 12.0;
        assert!(d.abs() > 3.0 || (field.value(&p) - d).abs() < 0.1);
    }
}

#[test]
fn a_sheet_settings_out_of_range_and_cancellation_are_refused() {
    let sheet = [Point::origin(), Point::new(6.3, 0.0, 0.0), Point::new(0.0, 6.1, 1.0)];
    let sheet = TriMesh::new(sheet.to_vec(), vec![[0, 1, 2]]).unwrap();
    let with = |spacing_mm, closing_mm, min_visibility| {
        envelope(&sheet, &EnvelopeSettings { spacing_mm, closing_mm, min_visibility }, &Control::new()).map(|_| ())
    };
    assert!(matches!(with(1.0, 2.0, 0.06), Err(FieldError::NothingInside)));
    assert!(matches!(with(0.0, 2.0, 0.06), Err(FieldError::Setting { name: "spacing_mm", .. })));
    assert!(matches!(with(1.0, 1.0, 0.06), Err(FieldError::Setting { name: "closing_mm", .. })));
    assert!(matches!(with(1.0, 2.0, 0.9), Err(FieldError::Setting { name: "min_visibility", .. })));
    let cancelled = Control::new();
    cancelled.cancel();
    let found = envelope(&sheet, &EnvelopeSettings::default(), &cancelled);
    assert!(matches!(found, Err(FieldError::Cancelled(_))));
}
