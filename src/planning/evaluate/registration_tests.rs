//! Registration and error maps on what users send: noise, misplacement, wrong units, mirror images.

use nalgebra::UnitQuaternion;

use super::png::Decoded;
use super::tests::{potato, star};
use super::*;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};

/// Repeatable normal deviates: sums of twelve uniform ones.
pub(super) struct Noise(u64);

impl Noise {
    pub(super) fn new() -> Self {
        Self(1)
    }

    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    pub(super) fn on(&mut self, mesh: &TriMesh, sigma_mm: f64) -> TriMesh {
        let p = mesh.positions().iter().map(|p| p + Vector::new(self.next(), self.next(), self.next()) * sigma_mm);
        mesh.with_positions(p.collect()).unwrap()
    }
}

fn refused(source: &TriMesh, target: &TriMesh, mask: Option<&[bool]>) -> RegistrationFault {
    match register(source, target, mask, &Control::new()) {
        Err(EvaluateError::Registration(fault)) => fault,
        other => panic!("{other:?}"),
    }
}

fn turned(axis: [f64; 3], degrees: f64, shift: [f64; 3]) -> Motion {
    let rotation = UnitQuaternion::from_scaled_axis(Vector::from(axis).normalize() * degrees.to_radians());
    Motion::from_parts(Vector::from(shift).into(), rotation)
}

#[test]
fn ten_millimetres_and_ten_degrees_in_any_direction_are_recovered_from_a_noisy_scan() {
    let target = Noise::new().on(&potato(70), 0.3);
    let source = potato(61);
    for axis in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -2.0, 1.5]] {
        let known = turned(axis, 10.0, [6.0, -6.5, 4.7]);
        let found = register(&source.moved(&known.inverse()), &target, None, &Control::new()).unwrap();
        let off = found.motion * known.inverse();
        let (shift, angle) = (off.translation.vector.norm(), off.rotation.angle().to_degrees());
        // 0.3 mm over some thousand vertices, most of which hold each motion by a tenth.
        assert!(shift < 0.1 && angle < 0.1, "{axis:?}: {shift} mm, {angle} degrees");
        assert!(found.residual_mm > 0.1 && found.residual_mm < 0.35 && found.overlap > 0.9, "{found:?}");
    }
}

#[test]
fn a_round_head_in_a_fine_scan_is_not_held_by_the_noise_of_its_facets() {
    // Nose, chin and ears on what is nearly a ball: only they tell how it is turned.
    let bump = |d: &Vector, at: [f64; 3], width: f64| {
        (-(d - Vector::from(at).normalize()).norm_squared() / (width * width)).exp()
    };
    let head = |d: &Vector| {
        let ball = 1.0 / Vector::new(d.x / 84.0, d.y / 90.0, d.z / 96.0).norm();
        let ears = bump(d, [1.0, 0.1, 0.0], 0.15) + bump(d, [-1.0, 0.1, 0.0], 0.15);
        ball + 18.0 * bump(d, [0.0, -1.0, 0.0], 0.22) + 8.0 * bump(d, [0.0, -0.8, -0.8], 0.3) + 5.0 * ears
    };
    let (target, source) = (Noise::new().on(&star(110, head), 0.3), star(61, head));
    for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
        let known = turned(axis, 5.0, [3.0, -3.0, 2.6]);
        let found = register(&source.moved(&known.inverse()), &target, None, &Control::new()).unwrap();
        let off = found.motion * known.inverse();
        let (shift, angle) = (off.translation.vector.norm(), off.rotation.angle().to_degrees());
        assert!(shift < 0.1 && angle < 0.1, "{axis:?}: {shift} mm, {angle} degrees");
    }
}

#[test]
fn shapes_that_slide_are_refused_even_when_noise_roughens_them() {
    let at = |i: u32| Point::new(f64::from(i % 30) * 3.0, f64::from(i / 30) * 3.0, 0.0);
    let squares =
        (0..29 * 30).filter(|i| i % 30 < 29).flat_map(|i| [[i, i + 1, i + 31], [i, i + 31, i + 30]]).collect();
    let plane = TriMesh::new((0..900).map(at).collect(), squares).unwrap();
    for body in [plane, star(40, |_| 60.0)] {
        for sigma in [0.0, 0.3] {
            let rough = Noise::new().on(&body, sigma);
            let fault = refused(&rough, &body, None);
            assert!(matches!(fault, RegistrationFault::ShapeUndetermined { .. }), "{sigma}: {fault:?}");
        }
    }
}

#[test]
fn strangers_small_regions_and_masks_of_another_length_are_refused_by_name() {
    let potato = potato(30);
    assert_eq!(refused(&potato, &star(30, |_| 50.0), None).reason(), "no_match");
    let few: Vec<bool> = (0..potato.positions().len()).map(|v| v < 20).collect();
    assert_eq!(refused(&potato, &potato, Some(&few)).reason(), "region_too_small");
    let none = vec![false; potato.positions().len()];
    assert_eq!(refused(&potato, &potato, Some(&none)).reason(), "region_too_small");
    let input = register(&potato, &potato, Some(&few[1..]), &Control::new());
    assert!(matches!(input, Err(EvaluateError::Input { .. })));
}

#[test]
fn metres_are_not_taken_for_millimetres() {
    let ball = star(20, |d| 80.0 + 10.0 * d.x);
    let p = ball.positions().iter().map(|p| p * 1e-3).collect();
    let metres = ball.with_positions(p).unwrap();
    for (a, b) in [(&metres, &ball), (&ball, &metres)] {
        let map = error_map(a, b, None, &[], &Control::new()).unwrap_err().to_string();
        let moved = register(a, b, None, &Control::new()).unwrap_err().to_string();
        assert!(map.contains("1000 times") && map.contains("metres") && map == moved, "{map}");
    }
}

#[test]
fn far_surfaces_are_told_apart_and_brought_together() {
    let potato = potato(30);
    let far = potato.moved(&Motion::translation(400.0, 0.0, 0.0));
    let map = error_map(&far, &potato, None, &[], &Control::new()).unwrap();
    assert!(map.warnings.iter().any(|w| w.code == "surfaces-apart"), "{:?}", map.warnings);
    assert!(map.warnings.iter().any(|w| w.code == "not-registered"), "{:?}", map.warnings);
    let found = register(&far, &potato, None, &Control::new()).unwrap();
    assert!((found.motion.translation.vector.x + 400.0).abs() < 1e-3);
}

#[test]
fn identical_surfaces_have_no_error_at_all_and_vertices_their_counterparts() {
    let potato = potato(30);
    let map = error_map(&potato, &potato, None, &[], &Control::new()).unwrap();
    assert!(map.signed_mm.iter().all(|v| *v == 0.0));
    assert_eq!((map.whole.max, map.backward.max, map.smoothed.max, map.roughness_mm), (0.0, 0.0, 0.0, 0.0));
    assert_eq!(map.correspondence.unwrap().whole.max, 0.0);
    // A ball that turns on itself: closest points see nothing, counterparts do.
    let ball = star(60, |_| 50.0);
    let map =
        error_map(&ball.moved(&turned([0.0, 0.0, 1.0], 4.0, [0.0; 3])), &ball, None, &[], &Control::new()).unwrap();
    let moved = 2.0 * 50.0 * (2.0f64).to_radians().sin();
    assert!(map.whole.max < 0.1 && (map.correspondence.unwrap().whole.max - moved).abs() < 1e-3);
    assert!(error_map(&star(59, |_| 50.0), &ball, None, &[], &Control::new()).unwrap().correspondence.is_none());
}

#[test]
fn the_sign_turns_when_prediction_and_reference_change_places() {
    let (small, large) = (star(40, |_| 50.0), star(37, |_| 51.5));
    let there = error_map(&small, &large, None, &[], &Control::new()).unwrap();
    let back = error_map(&large, &small, None, &[], &Control::new()).unwrap();
    assert!((there.whole.mean + 1.5).abs() < 0.1 && (back.whole.mean - 1.5).abs() < 0.1);
    assert!((there.backward.mean + 1.5).abs() < 0.1 && (back.backward.mean - 1.5).abs() < 0.1);
}

#[test]
fn inside_out_is_refused_and_a_mirror_image_is_suspected() {
    let potato = potato(50);
    let turned_out: Vec<[u32; 3]> = potato.triangles().iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let inside_out = TriMesh::new(potato.positions().to_vec(), turned_out.clone()).unwrap();
    let error = error_map(&potato, &inside_out, None, &[], &Control::new()).unwrap_err().to_string();
    assert!(error.contains("inside out"), "{error}");
    // A body with two bumps on one side only.
    let lopsided = star(60, |d| {
        let bump =
            |x: f64, y: f64, z: f64| 25.0 * (-20.0 * (d - Vector::new(x, y, z).normalize()).norm_squared()).exp();
        70.0 + 15.0 * d.z + bump(1.0, 0.3, 0.2) + bump(0.4, -1.0, 0.5)
    });
    let p = lopsided.positions().iter().map(|p| Point::new(-p.x, p.y, p.z)).collect();
    let flipped = lopsided.triangles().iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let mirrored = TriMesh::new(p, flipped).unwrap();
    let found = match register(&lopsided, &mirrored, None, &Control::new()) {
        Err(error) => error.to_string(),
        Ok(found) => found.warnings.iter().map(Warning::to_string).collect(),
    };
    assert!(found.contains("mirror"), "{found}");
}

#[test]
fn triangles_without_area_do_no_harm() {
    let potato = potato(30);
    let (mut p, mut t) = (potato.positions().to_vec(), potato.triangles().to_vec());
    let first = p.len() as u32;
    p.extend([p[5], p[5], p[9]]);
    t.extend([[first, first, first], [first, first + 1, first + 2], [7, 7, 9]]);
    let spiky = TriMesh::new(p, t).unwrap();
    let map = error_map(&spiky, &spiky, None, &[], &Control::new()).unwrap();
    assert!(map.whole.max == 0.0 && map.backward.max == 0.0);
    assert!(register(&spiky, &potato, None, &Control::new()).unwrap().residual_mm < 1e-6);
    let point = TriMesh::new(vec![Point::origin(); 3], vec![[0, 1, 2]]).unwrap();
    let error = error_map(&point, &potato, None, &[], &Control::new()).unwrap_err().to_string();
    assert!(error.contains("no area"), "{error}");
}

#[test]
fn averaging_takes_the_noise_of_a_scan_out_of_the_mean_error() {
    // True error: 0.4 mm one way in front, 0.4 mm the other way behind.
    let truth = |d: &Vector| 0.4 * (4.0 * d.y).tanh();
    let prediction = star(90, |d| 80.0 + truth(d));
    let scan = Noise::new().on(&star(83, |_| 80.0), 0.3);
    let clean = error_map(&prediction, &star(83, |_| 80.0), None, &[], &Control::new()).unwrap();
    let map = error_map(&prediction, &scan, None, &[], &Control::new()).unwrap();
    let off = |found: f64| (found / clean.whole.mean_abs - 1.0).abs();
    assert!(off(map.smoothed.mean_abs) < 0.05, "{} {}", map.smoothed.mean_abs, clean.whole.mean_abs);
    assert!(map.roughness_mm > 0.1 && map.roughness_mm < 0.3 && clean.roughness_mm < 0.05, "{}", map.roughness_mm);
}

#[test]
fn a_sheet_has_the_patients_left_on_the_right() {
    let ball = star(24, |_| 50.0);
    let values: Vec<f32> = ball.positions().iter().map(|p| (p.x / 50.0 * 3.0) as f32).collect();
    let map = error_map(&ball, &star(24, |_| 51.0), None, &[], &Control::new()).unwrap();
    let lines = [("mean".to_owned(), "-1.00".to_owned())];
    let shown =
        Sheet { title: "Error", mesh: &ball, values: &values, limit_mm: 3.0, histogram: &map.histogram, lines: &lines };
    let image = Decoded::of(&render_sheet(&shown));
    assert_eq!(image.size, (1380, 1184));
    // The second panel is the front view: red (positive, here the patient's left) on the right.
    let front = |x: i64| image.pixel((460 + 230 + x) as u32, 44 + 270);
    let (left, right) = (front(-150), front(150));
    assert!(left[2] > left[0] && right[0] > right[2], "{left:?} {right:?}");
    // From the patient's right all is blue, from the left red.
    let side = |panel: u32| image.pixel(panel * 460 + 230, 44 + 570 + 270);
    assert!(side(0)[2] > side(0)[0] && side(1)[0] > side(1)[2]);
    assert_eq!(render_sheet(&shown), render_sheet(&shown));
}

/// The paper's protocol on an analytic truth; `prosopon bench truth` has the solver's.
#[test]
fn a_noisy_misplaced_scan_of_a_head_tells_the_true_error_of_a_prediction() {
    let head = crate::phantom::head();
    let lip = Point::new(0.0, -95.0, 18.0);
    // A Le Fort I advance as the skin sees it.
    let advanced = |mesh: &TriMesh, share: f64| {
        let moved = |p: &Point| share * (-(p - lip).norm_squared() / (2.0 * 18.0 * 18.0)).exp();
        let p = mesh.positions().iter().map(|p| p + Vector::new(0.0, -6.0, -1.5) * moved(p)).collect();
        mesh.with_positions(p).unwrap()
    };
    let sampled = |spacing| crate::phantom::surface_of(head.skin.as_ref(), &head.bounds(), spacing).unwrap();
    let skin = sampled(2.5);
    let (prediction, truth) = (advanced(&skin, 0.9), advanced(&skin, 1.0));
    let displaced = |v: usize| (prediction.positions()[v] - skin.positions()[v]).norm();
    let n = skin.positions().len();
    let face: Vec<bool> = (0..n).map(|v| displaced(v) > 1.0).collect();
    let unmoved: Vec<bool> = (0..n).map(|v| displaced(v) < 0.1).collect();
    let control = Control::new();
    let real = error_map(&prediction, &truth, Some(&face), &[], &control).unwrap().whole;
    let known = turned([1.0, -1.0, 0.5], 5.0, [3.0, -3.0, 2.65]);
    let scan = Noise::new().on(&advanced(&sampled(2.1), 1.0), 0.3).moved(&known);
    let found = register(&prediction, &scan, Some(&unmoved), &control).unwrap();
    let off = found.motion * known.inverse();
    let middle = known * Point::new(0.0, -10.0, 50.0);
    let (shift, angle) = ((off * middle - middle).norm(), off.rotation.angle().to_degrees());
    assert!(shift < 0.1 && angle < 0.1, "{shift} mm, {angle} degrees");
    let registered = error_map(&prediction.moved(&found.motion), &scan, Some(&face), &[], &control).unwrap();
    let share = |found: f64, real: f64| (found / real - 1.0).abs();
    assert!(share(registered.whole.mean, real.mean) < 0.1, "{} {}", registered.whole.mean, real.mean);
    let (found, expected) = (registered.smoothed.mean_abs, real.mean_abs);
    assert!(share(found, expected) < 0.1, "{found} {expected}");
}
