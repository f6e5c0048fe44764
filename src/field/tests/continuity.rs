use super::shapes::{Random, block, fields, joined, sphere};
use crate::{ExactDistance, Method, SignedField};
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

const BAND_MM: f64 = 1.5;
const SPACING_MM: f64 = 0.5;
/// Distance between neighbouring samples on a line, mm.
const STEP_MM: f64 = 0.002;

/// A ball beside a plate of 0.5 mm, which produces cells of every size.
fn surface() -> TriMesh {
    let plate = block(Point::new(8.5, 0.1, 0.2), Vector::new(3.0, 3.0, 0.25));
    joined(&sphere(Point::origin(), 4.0, 4), &plate)
}

/// Largest jump of the value along random lines, and where it is; only at points that `counts` accepts.
///
/// A jump is a change that the gradients on both sides of a step do not explain. A continuous function with at most one kink in a
/// step changes by an amount between the steps with the two gradients. Curvature of at most about 10 / h adds
/// 10 / 0.25 mm × step² = 2e-4 mm.
fn largest_jump(field: &SignedField, counts: impl Fn(&Point) -> bool) -> (f64, Point) {
    let domain = field.domain();
    let size = domain.max - domain.min;
    let mut random = Random(50);
    let mut largest = (0.0, domain.min);
    for _ in 0..30 {
        // The line crosses the domain and extends a little beyond it.
        let [from, to] = [0, 1].map(|_| domain.min + size.map(|s| s * (1.1 * random.unit() - 0.05)));
        let n = ((to - from).norm() / STEP_MM) as usize;
        let step = (to - from) / n as f64;
        let mut last = field.value_gradient(&from);
        for i in 1..=n {
            let p = from + step * i as f64;
            let next = field.value_gradient(&p);
            let change = next.0 - last.0;
            let middle = 0.5 * (last.1 + next.1).dot(&step);
            let kink = 0.5 * (next.1 - last.1).dot(&step).abs();
            let jump = (change - middle).abs() - kink;
            if jump > largest.0 && counts(&p) {
                largest = (jump, p);
            }
            last = next;
        }
    }
    largest
}

#[test]
fn the_value_does_not_jump_between_cells_of_different_size() {
    let surface = surface();
    let exact = ExactDistance::new(&surface);
    for (method, field, _) in fields(&surface, SPACING_MM, BAND_MM) {
        match method {
            Method::Uniform | Method::Adaptive => {
                let (jump, at) = largest_jump(&field, |_| true);
                assert!(jump < 2e-4, "{method:?}: {jump} at {at}");
            }
            // The papers' octrees jump where a cell meets smaller ones: in the band by up to the tolerance of 0.01 mm on each
            // side, beyond it by much more.
            Method::Frisken | Method::Hybrid => {
                let (jump, at) = largest_jump(&field, |p| exact.closest(p).2 < BAND_MM);
                assert!(jump < 0.02, "{method:?}: {jump} at {at}");
            }
        }
    }
}

#[test]
fn value_and_gradient_agree_on_both_sides_of_every_face_of_the_adaptive_field() {
    let (_, field, _) = fields(&surface(), SPACING_MM, BAND_MM).pop().unwrap();
    let SignedField::Adaptive(field) = field else { panic!("the last method is the adaptive one") };
    let domain = field.domain();
    let mut random = Random(51);
    let (mut checked, mut bent) = ([0; 5], 0);
    for n in 0..60_000 {
        // Faces of detail cells (half a spacing), of cells, and of bricks.
        let level = n % 5;
        let step = [0.5, 1.0, 4.0, 8.0, 16.0][level] * field.spacing_mm();
        let axis = n / 5 % 3;
        let mut p = random.point(if n % 2 == 0 { Point::origin() } else { Point::new(7.0, 0.0, 0.0) }, 6.0);
        p[axis] = domain.min[axis] + ((p[axis] - domain.min[axis]) / step).round() * step;
        if !domain.grown(-0.1).contains(&p) {
            continue;
        }
        let offset = Vector::ith(axis, 1e-9);
        let (v0, g0, h0) = field.value_gradient_hessian(&(p - offset));
        let (v1, g1, h1) = field.value_gradient_hessian(&(p + offset));
        // The derivatives explain this much of the change over 2e-9 mm; the rest is round-off.
        assert!((v1 - v0 - 1e-9 * (g0 + g1)[axis]).abs() < 1e-12, "{p}: {v0} {v1} {g0} {g1}");
        assert!((g1 - g0).norm() < 2e-9 * (h0.norm() + h1.norm()) + 1e-11, "{p}: {g0} {g1}");
        checked[level] += 1;
        bent += usize::from((h1 - h0).norm() > 1e-3);
    }
    // The second derivative jumps there, so the points do lie on faces.
    assert!(checked.iter().all(|n| *n > 3000) && bent > 5000, "{checked:?} {bent}");
}
