use super::shapes::{Random, block, joined, sphere};
use crate::control::Control;
use crate::field::{DistanceField, ExactDistance, FieldSettings};
use crate::geometry::{Implicit, Point, TriMesh, Vector};

/// A solid with sharp edges, a thin plate, and a sphere that cuts through both.
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
            // Inside, on an edge, at a vertex.
            let (u, v) = match n % 4 {
                0 => (random.unit(), 0.0),
                1 => (0.0, 0.0),
                _ => (random.unit(), random.unit()),
            };
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            largest = largest.max(field.value(&(a + (b - a) * u + (c - a) * v)).abs());
        }
        // Parts are divided until the bound is a twentieth above the largest value at their middles; random points miss it by more.
        assert!(largest <= bound && bound < 1.25 * largest, "{largest} {bound}");
    }
}
