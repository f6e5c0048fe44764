use super::shapes::{Random, fields, torus};
use crate::{ExactDistance, Method};
use prosopon_geometry::{Implicit, Point, Vector};

/// Spacings; each is half of the one before, mm.
const SPACINGS_MM: [f64; 3] = [1.6, 0.8, 0.4];

/// RMS errors of every method at each spacing, at points up to 1.5 mm off a torus, mm.
///
/// The points are away from the medial axis, and the facets are so small that the surface is smooth at these spacings.
fn errors() -> Vec<(Method, [f64; 3])> {
    let mesh = torus(Point::origin(), 6.0, 3.0, 160);
    let exact = ExactDistance::new(&mesh);
    let mut random = Random(40);
    let probes: Vec<(Point, f64)> = (0..4000)
        .map(|_| {
            let [u, v] = [0, 1].map(|_| std::f64::consts::TAU * random.unit());
            let small = 3.0 + 1.5 * (2.0 * random.unit() - 1.0);
            let r = 6.0 + small * v.cos();
            let p = Point::from(Vector::new(r * u.cos(), r * u.sin(), small * v.sin()));
            (p, exact.signed(&p))
        })
        .collect();
    let mut found: Vec<(Method, [f64; 3])> = Method::ALL.map(|m| (m, [0.0; 3])).into();
    for (n, spacing) in SPACINGS_MM.into_iter().enumerate() {
        for ((_, rms), (_, field, _)) in found.iter_mut().zip(fields(&mesh, spacing, 2.0)) {
            let sum: f64 = probes.iter().map(|(p, d)| (field.value(p) - d).powi(2)).sum();
            rms[n] = (sum / probes.len() as f64).sqrt();
        }
    }
    found
}

#[test]
fn halving_the_spacing_reduces_the_error_at_the_order_of_the_method() {
    for (method, rms) in errors() {
        let order = (rms[0] / rms[2]).log2() / 2.0;
        // The error is of second order for trilinear functions and of third for quadratic splines; facets limit the finest
        // spacing.
        let expected = if method == Method::Adaptive { 3.0 } else { 2.0 };
        assert!((order - expected).abs() < 0.3, "{method:?}: {order} by {rms:?}");
        assert!(rms[2] < 0.01, "{method:?}: {rms:?}");
    }
}
