//! Error maps, registration and pictures on balls and potatoes.

use std::f64::consts::PI;

use nalgebra::UnitQuaternion;

use super::png::Decoded;
use super::*;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Motion, Point, TriMesh, Vector};

/// A closed star-shaped surface: `radius` of the direction; `n` rings.
pub(super) fn star(n: usize, radius: impl Fn(&Vector) -> f64) -> TriMesh {
    let m = 2 * n;
    let direction = |ring: usize, i: usize| {
        let (polar, around) = (PI * ring as f64 / n as f64, 2.0 * PI * i as f64 / m as f64);
        Vector::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos())
    };
    let at = |d: Vector| Point::from(d * radius(&d));
    let mut p = vec![at(Vector::z())];
    p.extend((1..n).flat_map(|r| (0..m).map(move |i| (r, i))).map(|(r, i)| at(direction(r, i))));
    p.push(at(-Vector::z()));
    let last = p.len() as u32 - 1;
    let id = |r: usize, i: usize| (1 + (r - 1) * m + i % m) as u32;
    let mut t = Vec::new();
    for i in 0..m {
        t.push([0, id(1, i), id(1, i + 1)]);
        t.push([last, id(n - 1, i + 1), id(n - 1, i)]);
        for r in 1..n - 1 {
            t.push([id(r, i), id(r + 1, i), id(r + 1, i + 1)]);
            t.push([id(r, i), id(r + 1, i + 1), id(r, i + 1)]);
        }
    }
    TriMesh::new(p, t).unwrap()
}

pub(super) fn potato(n: usize) -> TriMesh {
    star(n, |d| 80.0 + 12.0 * d.x * d.y + 9.0 * d.z * d.z * d.x - 15.0 * d.y.powi(3) + 6.0 * (5.0 * d.x).sin() * d.z)
}

fn known() -> Motion {
    let rotation = UnitQuaternion::from_scaled_axis(Vector::new(0.08, -0.12, 0.1));
    Motion::from_parts(Vector::new(4.0, -7.0, 3.0).into(), rotation)
}

/// Largest movement left over the vertices of `mesh`.
fn residual(mesh: &TriMesh, motion: &Motion) -> f64 {
    mesh.positions().iter().map(|p| (motion * p - p).norm()).fold(0.0, f64::max)
}

#[test]
fn an_offset_ball_gives_a_constant_map_of_the_right_sign() {
    let reference = star(60, |_| 50.0);
    for offset in [-1.5, 2.25] {
        let prediction = star(48, |_| 50.0 + offset);
        let map = error_map(&prediction, &reference, None, &[], &Control::new()).unwrap();
        // The chords of the reference lie below the ball by up to r (edge / 2r)² / 2 = 0.07 mm.
        assert!(map.signed_mm.iter().all(|v| (f64::from(*v) - offset).abs() < 0.1));
        assert!((map.whole.mean - offset).abs() < 0.07 && (map.backward.mean - offset).abs() < 0.1);
        assert_eq!(map.excluded, 0);
        let (edge, share) = *map.histogram.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!(edge <= offset + 0.1 && offset < edge + 0.25 && share > 0.9, "{edge} {share}");
        assert!((map.histogram.iter().map(|b| b.1).sum::<f64>() - 1.0).abs() < 1e-9);
        assert_eq!((map.histogram.len(), map.histogram[0].0, map.histogram[25].0), (26, -3.25, 3.0));
    }
}

#[test]
fn far_errors_fall_into_the_open_ends_of_the_histogram() {
    let reference = star(24, |_| 50.0);
    let map = error_map(&star(24, |_| 42.0), &reference, None, &[], &Control::new()).unwrap();
    assert!((map.histogram[0].1 - 1.0).abs() < 1e-9);
}

#[test]
fn beyond_the_border_of_an_open_reference_nothing_is_counted() {
    let ball = star(24, |_| 50.0);
    let upper: Vec<[u32; 3]> =
        ball.triangles().iter().copied().filter(|t| t.iter().all(|v| ball.positions()[*v as usize].z > -1.0)).collect();
    let patch = TriMesh::new(ball.positions().to_vec(), upper).unwrap();
    let map = error_map(&star(24, |_| 51.0), &patch, None, &[], &Control::new()).unwrap();
    assert!(map.excluded > 500 && map.excluded < 1100 && map.whole.count > 400, "{}", map.excluded);
    assert!((map.whole.mean - 1.0).abs() < 0.05 && map.whole.max < 1.1);
    assert!(map.signed_mm.iter().filter(|v| v.is_nan()).count() == map.excluded);
    // Vertices doubled, as in STL: the same map.
    let soup: Vec<Point> = (0..patch.triangles().len()).flat_map(|t| patch.corners(t)).collect();
    let loose = (0..patch.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let again =
        error_map(&star(24, |_| 51.0), &TriMesh::new(soup, loose).unwrap(), None, &[], &Control::new()).unwrap();
    assert_eq!(map.excluded, again.excluded);
}

#[test]
fn masks_and_regions_choose_what_is_counted() {
    let reference = star(24, |_| 50.0);
    let prediction = star(24, |d| if d.z > 0.0 { 52.0 } else { 49.0 });
    let mask: Vec<bool> = prediction.positions().iter().map(|p| p.z > 5.0).collect();
    let half = |name, min: f64, max: f64| {
        FaceRegion::new(name, Aabb { min: Point::new(-60.0, -60.0, min), max: Point::new(60.0, 60.0, max) })
    };
    let regions = [half("forehead", 20.0, 60.0), half("chin", -60.0, -20.0)];
    let map = error_map(&prediction, &reference, Some(&mask), &regions, &Control::new()).unwrap();
    assert_eq!(map.whole.count, mask.iter().filter(|m| **m).count());
    assert!((map.whole.mean - 2.0).abs() < 0.05 && (map.backward.mean - 2.0).abs() < 0.2);
    assert_eq!(map.regions.iter().map(|r| r.0).collect::<Vec<_>>(), ["forehead"]);
    let map = error_map(&prediction, &reference, None, &regions, &Control::new()).unwrap();
    assert!((map.regions[1].1.mean + 1.0).abs() < 0.05);
    assert!(matches!(
        error_map(&prediction, &reference, Some(&mask[1..]), &[], &Control::new()),
        Err(EvaluateError::Input { .. })
    ));
}

#[test]
fn a_known_motion_is_recovered_on_clean_data() {
    let target = potato(40);
    let source = target.moved(&known().inverse());
    let found = register(&source, &target, None, &Control::new()).unwrap();
    assert!(residual(&target, &(found.motion * known().inverse())) < 1e-6);
    assert!(found.residual_mm < 1e-6 && found.overlap > 0.99 && found.iterations > 0 && found.warnings.is_empty());
    assert_eq!(found.vertices, target.positions().len());
}

#[test]
fn other_triangles_and_an_altered_part_hardly_disturb_the_registration() {
    let target = potato(100);
    // Three tenths of the surface stand out by up to 8 mm.
    let bump = |d: &Vector| 8.0 * ((d.y - 0.4) / 0.6).clamp(0.0, 1.0).sqrt();
    // The same vertices, then others: then chords differ by up to 0.03 mm, and a potato is nearly round.
    for (n, allowed) in [(100, 0.02), (83, 0.06)] {
        let before = potato(n);
        let p = before.positions().iter().map(|p| p + p.coords.normalize() * bump(&p.coords.normalize())).collect();
        let source = before.with_positions(p).unwrap().moved(&known().inverse());
        let found = register(&source, &target, None, &Control::new()).unwrap();
        let off = residual(&target, &(found.motion * known().inverse()));
        assert!(off < allowed, "{n}: {off}");
        let unaltered: Vec<bool> = before.positions().iter().map(|p| p.coords.normalize().y < 0.4).collect();
        let found = register(&source, &target, Some(&unaltered), &Control::new()).unwrap();
        let masked = residual(&target, &(found.motion * known().inverse()));
        assert!(masked < allowed, "{n}: {masked}");
    }
}

#[test]
fn a_picture_is_a_png_of_the_asked_size_with_panels_in_order() {
    let ball = star(24, |_| 50.0);
    let values: Vec<f32> = ball.positions().iter().map(|p| (p.x / 50.0 * 3.0) as f32).collect();
    let view = View { direction: Vector::y(), up: Vector::z(), size_px: [640, 300] };
    let panels = [
        ("Before", Layer { mesh: &ball, values: None }),
        ("Error", Layer { mesh: &ball, values: Some(Coloured { values: &values, limit_mm: 3.0 }) }),
    ];
    let bytes = render_panels(&panels, &view);
    let image = Decoded::of(&bytes);
    assert_eq!(image.size, (640, 300));
    // Panels of (640 - 92) / 2 = 274 pixels; in the second, the patient's left (+x, here red) is on the right.
    let at = |x: u32| image.pixel(x, 157);
    assert_eq!(at(3), [255; 3]);
    let plain = at(137);
    assert!(plain[0] > plain[1] && plain[1] > plain[2]);
    let (left, right) = (at(274 + 137 - 90), at(274 + 137 + 90));
    assert!(left[2] > left[0] && right[0] > right[2], "{left:?} {right:?}");
    // The colour bar: red at the top.
    let bar = |y| image.pixel(548 + 17, y);
    assert!(bar(36)[0] > bar(36)[2] && bar(284)[2] > bar(284)[0]);
    assert_eq!(bytes, render_panels(&panels, &view));
}

#[test]
fn odd_pictures_are_still_pictures() {
    let ball = star(6, |_| 50.0);
    let layer = Layer { mesh: &ball, values: Some(Coloured { values: &[f32::NAN], limit_mm: 0.0 }) };
    for size_px in [[0, 0], [64, 9], [9, 500]] {
        for direction in [Vector::zeros(), Vector::z(), Vector::new(f64::NAN, 0.0, 1.0)] {
            let view = View { direction, up: Vector::z(), size_px };
            Decoded::of(&render_panels(&[("a title that is far too long", layer)], &view));
            Decoded::of(&render_panels(&[], &view));
        }
    }
}
