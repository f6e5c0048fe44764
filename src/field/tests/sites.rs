use super::shapes::{block, joined, sphere};
use crate::distance_field::Level;
use crate::sites::{SHORT, Spread, of_bricks};
use crate::{DistanceField, ExactDistance, FieldSettings};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, Vector};

#[test]
fn every_part_of_a_triangle_and_every_vertex_has_one_site() {
    // Triangles with one part each and triangles with 1369.
    let mesh = joined(&block(Point::origin(), Vector::new(9.0, 7.0, 5.0)), &sphere(Point::new(0.3, 14.0, 0.0), 5.0, 5));
    let exact = ExactDistance::new(&mesh);
    let settings = FieldSettings { spacing_mm: 0.4, band_mm: 1.0, margin_mm: 2.0 };
    let (field, _) = DistanceField::build_unmeasured(&exact, &mesh, &settings, &Control::new()).unwrap();
    let spread = Spread::new(&field, &mesh, &vec![true; mesh.triangles().len()]);
    let places = field.places(Level::Brick);
    let found: usize = of_bricks(&spread, &places).iter().map(|sites| sites.all.len()).sum();
    let parts: Vec<usize> = (0..mesh.triangles().len()).map(|t| spread.parts(t) as usize).collect();
    assert!(parts.contains(&1) && parts.iter().any(|n| *n > 2 * SHORT), "{parts:?}");
    assert_eq!(found, parts.iter().map(|n| n * n).sum::<usize>() + mesh.positions().len());
    let mut joints = 0;
    for (slot, at) in places.iter().enumerate() {
        spread.for_joints(slot, *at, |_| joints += 1);
    }
    assert_eq!(joints, parts.iter().map(|n| (n + 1) * (n + 2) / 2 - 3).sum::<usize>());
}
