use super::shapes::{Random, block, joined, sphere};
use crate::{Accuracy, DistanceField, ExactDistance, FieldSettings, sample_points};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};

/// A solid with sharp edges, a thin plate, and a sphere that intersects both.
fn rough() -> TriMesh {
    let solid = block(Point::origin(), Vector::new(9.0, 6.0, 4.0));
    let plate = block(Point::new(0.0, 0.0, 9.0), Vector::new(8.0, 7.0, 0.3));
    joined(&joined(&solid, &plate), &sphere(Point::new(3.0, 2.0, 6.0), 5.0, 3))
}

#[test]
fn no_point_of_the_surface_exceeds_the_bound_and_it_is_not_loose() {
    let mesh = rough();
    for spacing_mm in [0.5, 1.0] {
        let settings = FieldSettings { spacing_mm, band_mm: 2.0, margin_mm: 3.0 };
        let exact = ExactDistance::new(&mesh);
        let (field, _) = DistanceField::build_unmeasured(&exact, &mesh, &settings, &Control::new()).unwrap();
        let bound = field.surface_bound(&mesh, &exact, &Control::new()).unwrap().unwrap();
        let mut random = Random(7);
        let mut largest = 0.0f64;
        for n in 0..200_000 {
            let [a, b, c] = mesh.corners(n % mesh.triangles().len());
            // A point inside the triangle, on an edge, or at a vertex.
            let (u, v) = match n % 4 {
                0 => (random.unit(), 0.0),
                1 => (0.0, 0.0),
                _ => (random.unit(), random.unit()),
            };
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            largest = largest.max(field.value(&(a + (b - a) * u + (c - a) * v)).abs());
        }
        // Division stops when the bound is a twentieth above the largest value at middles; random points find smaller values.
        assert!(largest <= bound && bound < 1.25 * largest, "{largest} {bound}");
    }
}

#[test]
fn no_point_of_the_band_exceeds_the_bound_and_it_is_not_loose() {
    let mesh = rough();
    let control = Control::new();
    let band_mm = 2.0;
    for spacing_mm in [0.6, 1.2] {
        let settings = FieldSettings { spacing_mm, band_mm, margin_mm: 3.0 };
        let exact = ExactDistance::new(&mesh);
        let (field, _) = DistanceField::build_unmeasured(&exact, &mesh, &settings, &control).unwrap();
        let on_surface = field.surface_bound(&mesh, &exact, &control).unwrap().unwrap();
        let bound = field.band_bound(&mesh, &exact, band_mm, on_surface, &|| true, &control).unwrap().unwrap();
        assert_eq!(bound.share, 1.0);
        let bound = bound.bound_mm;
        // Points other than those that started the bound: random, on faces, on edges, on the medial axis.
        let points = sample_points(&mesh, &exact, band_mm, 77_777, &control).unwrap();
        let largest = Accuracy::measure(&field, &exact, &points, &control).unwrap().max_error_mm;
        // Division stops when the bound is a tenth above the largest error seen, or below 0.7 spacings.
        let enough = (1.15 * largest).max(0.7 * spacing_mm) + 1e-9;
        assert!(largest <= bound && bound <= enough, "{largest} {bound}");
    }
}

#[test]
fn an_open_surface_has_no_bound_in_the_band() {
    let whole = block(Point::origin(), Vector::new(4.0, 4.0, 4.0));
    let open = TriMesh::new(whole.positions().to_vec(), whole.triangles()[2..].to_vec()).unwrap();
    let exact = ExactDistance::new(&open);
    let settings = FieldSettings { spacing_mm: 0.8, band_mm: 2.0, margin_mm: 3.0 };
    let control = Control::new();
    let (field, _) = DistanceField::build_unmeasured(&exact, &open, &settings, &control).unwrap();
    assert_eq!(field.band_bound(&open, &exact, 2.0, 1.0, &|| true, &control).unwrap(), None);
}

#[test]
fn a_proof_that_is_stopped_says_so() {
    let mesh = rough();
    let control = Control::new();
    let settings = FieldSettings { spacing_mm: 1.2, band_mm: 1.0, margin_mm: 2.0 };
    let exact = ExactDistance::new(&mesh);
    let (field, _) = DistanceField::build_unmeasured(&exact, &mesh, &settings, &control).unwrap();
    let left = std::sync::atomic::AtomicIsize::new(3);
    let keep_going = || left.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) > 0;
    let part = field.band_bound(&mesh, &exact, 1.0, 1.0, &keep_going, &control).unwrap().unwrap();
    assert!(part.share > 0.0 && part.share < 1.0, "{part:?}");
}
