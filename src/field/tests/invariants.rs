//! Properties that hold for any surface.

use super::shapes::{Random, fields, rough_ball, torus};
use crate::{ExactDistance, Method, SignedField};
use proptest::prelude::*;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector};

const SPACING_MM: f64 = 0.6;
const BAND_MM: f64 = 2.0;

/// Random points within 90 % of the band.
fn points_of_the_band(exact: &ExactDistance, seed: u64, n: usize) -> Vec<Point> {
    let mut random = Random(seed);
    let points = std::iter::repeat_with(|| random.point(Point::origin(), 8.0));
    points.filter(|p| exact.closest(p).2 < 0.9 * BAND_MM).take(n).collect()
}

/// A ball with dents and spikes, with a sharp edge between any two triangles.
fn surfaces() -> impl Strategy<Value = TriMesh> {
    (any::<u64>(), 3.5..6.0, 0.0..0.25)
        .prop_map(|(seed, radius, roughness)| rough_ball(Point::origin(), radius, roughness, seed))
}

fn motions() -> impl Strategy<Value = Motion> {
    let unit = || -1.0..1.0f64;
    ((unit(), unit(), unit()), (unit(), unit(), unit()))
        .prop_map(|(t, r)| Motion::new(Vector::new(t.0, t.1, t.2) * 50.0, Vector::new(r.0, r.1, r.2) * 3.0))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_two_values_differ_by_more_than_their_distance_and_the_errors(mesh in surfaces(), seed in any::<u64>()) {
        let exact = ExactDistance::new(&mesh);
        let points = points_of_the_band(&exact, seed, 400);
        for (method, field, report) in fields(&mesh, SPACING_MM, BAND_MM) {
            let values: Vec<f64> = points.iter().map(|p| field.value(p)).collect();
            for (n, p) in points.iter().enumerate() {
                for (q, value) in points[..n].iter().zip(&values) {
                    let excess = (values[n] - value).abs() - (p - q).norm();
                    prop_assert!(excess <= 2.0 * report.max_error_mm, "{method:?}: {excess} at {p} and {q}");
                }
            }
        }
    }

    #[test]
    fn moving_the_surface_is_moving_the_query(mesh in surfaces(), motion in motions(), seed in any::<u64>()) {
        let points = points_of_the_band(&ExactDistance::new(&mesh), seed, 500);
        let moved = fields(&mesh.moved(&motion), SPACING_MM, BAND_MM);
        for ((method, here, report), (_, there, moved)) in fields(&mesh, SPACING_MM, BAND_MM).iter().zip(&moved) {
            let largest = points.iter().map(|p| (here.value(p) - there.value(&(motion * p))).abs()).fold(0.0, f64::max);
            prop_assert!(largest <= report.max_error_mm + moved.max_error_mm, "{method:?}: {largest}");
        }
    }

    #[test]
    fn the_gradient_is_the_central_difference_of_the_value(mesh in surfaces(), seed in any::<u64>()) {
        let exact = ExactDistance::new(&mesh);
        let points = points_of_the_band(&exact, seed, 400);
        for (method, field, _) in fields(&mesh, SPACING_MM, BAND_MM) {
            let mut faces = 0;
            for p in &points {
                let gradient = field.value_gradient(p).1;
                let slope = |step: f64| {
                    Vector::from_fn(|a, _| {
                        let step = Vector::ith(a, step);
                        (field.value(&(p + step)) - field.value(&(p - step))) / (2.0 * step.norm())
                    })
                };
                // A finite difference across a face between cells is not a derivative: there the two steps disagree.
                let (wide, narrow) = (slope(1e-5), slope(1e-6));
                if (wide - narrow).norm() > 1e-5 {
                    faces += 1;
                    continue;
                }
                prop_assert!((narrow - gradient).norm() < 1e-5, "{method:?} at {p}: {gradient} {narrow}");
            }
            prop_assert!(faces < 20, "{method:?}: {faces}");
        }
    }

    #[test]
    fn the_gradient_leads_away_from_the_surface(motion in motions(), seed in any::<u64>()) {
        let mesh = torus(Point::origin(), 6.0, 3.0, 96).moved(&motion);
        let mut random = Random(seed);
        let probes: Vec<(Point, Vector)> = (0..1000)
            .map(|_| {
                let [u, v] = [0, 1].map(|_| std::f64::consts::TAU * random.unit());
                let away = Vector::new(u.cos() * v.cos(), u.sin() * v.cos(), v.sin());
                let core = Point::new(6.0 * u.cos(), 6.0 * u.sin(), 0.0);
                // Points start 1 mm off the core circle, where the direction jumps.
                (motion * (core + away * (1.0 + 3.5 * random.unit())), motion.rotation * away)
            })
            .collect();
        for (method, field, _) in fields(&mesh, SPACING_MM, BAND_MM) {
            // Facets turn by 360° / 96 = 0.07. Over a cell the direction turns by up to h / 1 mm at the core; the gradient of a
            // trilinear function is off by half of that.
            let limit = if method == Method::Adaptive { 0.2 } else { 0.5 };
            for (p, direction) in &probes {
                let gradient = field.value_gradient(p).1;
                let off = (gradient - direction).norm();
                prop_assert!(off < limit, "{method:?} at {p}: {gradient} instead of {direction}");
            }
        }
    }
}

#[test]
fn every_method_gives_the_same_bits_and_report_on_any_number_of_threads() {
    let mut dirty = rough_ball(Point::origin(), 5.0, 0.2, 7);
    dirty = super::shapes::flipped(&super::shapes::filtered(&dirty, |t, _| t % 41 != 0), |t| t % 29 == 0);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let exact = ExactDistance::new(&dirty);
            let bits = |field: &SignedField| {
                let mut random = Random(60);
                let points = std::iter::repeat_with(|| random.point(Point::origin(), 9.0)).take(3000);
                let jets = points.map(|p| {
                    let (value, gradient) = field.value_gradient(&p);
                    [value, gradient.x, gradient.y, gradient.z, field.distance_with_checked_sign(&exact, &p).distance]
                        .map(f64::to_bits)
                });
                jets.collect::<Vec<_>>()
            };
            let found = fields(&dirty, 0.5, BAND_MM);
            found.into_iter().map(|(method, field, report)| (method, bits(&field), report)).collect::<Vec<_>>()
        })
    };
    let one: Vec<(Method, _, _)> = on(1);
    assert!(!one[0].2.regions.is_empty());
    assert!(one == on(2) && one == on(3));
}
