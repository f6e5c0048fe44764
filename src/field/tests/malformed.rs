//! Surfaces that break methods: each gives a correct field or a report of what is wrong and where.

use super::shapes::{Random, block, fields, filtered, flipped, joined, rough_ball, sphere};
use crate::{ExactDistance, FieldError, FieldReport, FieldSettings, Method, MethodSettings, RegionKind, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{GeometryError, Implicit, Motion, Point, TriMesh, Vector};

const BAND_MM: f64 = 2.0;
const SPACING_MM: f64 = 0.6;

/// A thick shell like a skull's, cut at z = 3 by the field of view.
fn open_skull() -> TriMesh {
    let shell = joined(&sphere(Point::origin(), 8.0, 4), &flipped(&sphere(Point::origin(), 6.0, 4), |_| true));
    filtered(&shell, |_, c| c.iter().all(|p| p.z < 3.0))
}

fn triangle(corners: [Point; 3]) -> TriMesh {
    TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap()
}

/// Checks every method on `mesh`.
///
/// Values are finite everywhere. In the band the magnitude is never more than a spacing above the distance, nor more than a
/// spacing below it where the sign does not jump nearby. An adaptive field's sign is that of the winding number where that is
/// clear. All methods report regions of the `expected` kinds, at positions within the surface's box.
fn check(mesh: &TriMesh, expected: &[RegionKind]) -> FieldReport {
    let exact = ExactDistance::new(mesh);
    let bounds = mesh.bounds();
    let mut random = Random(82);
    let is_inside = |p: Point| exact.winding_number(&p).abs() > 0.5;
    let encloses = (0..3000).any(|_| is_inside(random.point(bounds.center(), 0.5 * bounds.diagonal())));
    let jumps = !encloses || expected.iter().any(|kind| matches!(kind, RegionKind::Open | RegionKind::Buried));
    let mut report = None;
    for (method, field, found) in fields(mesh, SPACING_MM, BAND_MM) {
        let mut random = Random(80);
        let half = 0.5 * (bounds.max - bounds.min).max() + 6.0;
        let mut clear = 0;
        for _ in 0..3000 {
            let p = random.point(bounds.center(), half);
            let (value, gradient) = field.value_gradient(&p);
            assert!(value.is_finite() && gradient.iter().all(|g| g.is_finite()), "{method:?} at {p}");
            let (d, winding) = (exact.closest(&p).2, exact.winding_number(&p));
            if d > BAND_MM {
                continue;
            }
            assert!(value.abs() < d + SPACING_MM, "{method:?}: {value} instead of {d} at {p}");
            // On such surfaces pseudonormals may give the wrong sign anywhere, the winding number across openings.
            let is_clear = if method == Method::Adaptive { (winding.abs() - 0.5).abs() > 0.3 } else { !jumps };
            if is_clear {
                clear += 1;
                assert!(value.abs() > d - SPACING_MM, "{method:?}: {value} instead of {d} at {p}");
                assert!(d < 0.3 || (value < 0.0) == (winding.abs() > 0.5), "{method:?}: {value} at {p}, {winding}");
            }
        }
        assert!(clear > 40 || (jumps && method != Method::Adaptive), "{method:?}: {clear}");
        let kinds: Vec<RegionKind> = found.regions.iter().map(|r| r.kind).collect();
        assert_eq!(kinds, expected, "{method:?}");
        for region in found.regions.iter().flat_map(|r| &r.largest) {
            assert!(bounds.grown(1e-9).contains(&region.bounds.min) && bounds.grown(1e-9).contains(&region.bounds.max));
        }
        report = Some(found);
    }
    report.unwrap()
}

#[test]
fn a_skull_cut_at_the_field_of_view() {
    let report = check(&open_skull(), &[RegionKind::Open, RegionKind::Ambiguous]);
    // One rim outside and one inside, both at the cut.
    assert_eq!(report.regions[0].count, 2);
    assert!(report.regions[0].largest.iter().all(|rim| rim.bounds.min.z > 1.5 && rim.bounds.max.z < 3.0));
}

#[test]
fn copied_and_flipped_faces() {
    let ball = rough_ball(Point::origin(), 6.0, 0.1, 3);
    let mut triangles = ball.triangles().to_vec();
    triangles.extend(ball.triangles()[..20].iter().map(|&[a, b, c]| [b, c, a]));
    let doubled = TriMesh::new(ball.positions().to_vec(), triangles).unwrap();
    assert_eq!(check(&doubled, &[RegionKind::Copy]).regions[0].elements, 20);
    let inverted = flipped(&ball, |t| t == 100);
    let report = check(&inverted, &[RegionKind::Inverted]);
    assert_eq!((report.regions[0].count, report.regions[0].elements), (1, 1));
    assert!(report.regions[0].largest[0].bounds.contains(&ball.corners(100)[0]));
}

#[test]
fn self_intersections() {
    let a = sphere(Point::new(-3.0, 0.0, 0.0), 5.0, 3);
    check(&joined(&a, &block(Point::new(3.0, 0.5, 0.2), Vector::new(4.0, 2.0, 2.5))), &[RegionKind::Buried]);
}

#[test]
fn triangles_without_area_and_a_needle_of_one_to_ten_thousand() {
    let ball = sphere(Point::origin(), 6.0, 3);
    let mut triangles = ball.triangles().to_vec();
    let [a, b, _] = triangles[40];
    triangles.extend([[a, a, b], [7, 7, 7]]);
    let flat = TriMesh::new(ball.positions().to_vec(), triangles).unwrap();
    assert_eq!(check(&flat, &[RegionKind::NoArea]).regions[0].elements, 2);
    // Two needles along a side of a block, 12 mm long and 0.0012 mm wide, as part of its closed surface.
    let block = block(Point::origin(), Vector::new(6.0, 3.0, 3.0));
    let mut positions = block.positions().to_vec();
    positions.push(Point::new(0.0, -3.0, -3.0 + 0.0012));
    let triangles = block.triangles().iter().flat_map(|&[a, b, c]| {
        // The side's triangle over the edge from corner 0 to corner 1 is split at the new vertex.
        let side = [a, b, c].contains(&0) && [a, b, c].contains(&1) && [a, b, c].contains(&5);
        if side { vec![[a, b, 8], [b, c, 8], [c, a, 8]] } else { vec![[a, b, c]] }
    });
    let needles = TriMesh::new(positions, triangles.collect()).unwrap();
    assert_eq!(needles.triangles().len(), 14);
    check(&needles, &[]);
    let needle = triangle([Point::origin(), Point::new(10.0, 0.0, 0.0), Point::new(5.0, 0.001, 0.0)]);
    check(&needle, &[RegionKind::Open, RegionKind::Ambiguous]);
}

#[test]
fn coincident_sheets_and_one_triangle() {
    let one = triangle([Point::origin(), Point::new(6.0, 0.0, 0.0), Point::new(0.0, 6.0, 1.0)]);
    let report = check(&one, &[RegionKind::Open, RegionKind::Ambiguous]);
    assert_eq!((report.regions[0].elements, report.regions[1].elements), (3, 1));
    assert_eq!(check(&joined(&one, &flipped(&one, |_| true)), &[RegionKind::Copy]).regions[0].elements, 2);
    let report = check(&joined(&one, &one), &[RegionKind::Open, RegionKind::Ambiguous, RegionKind::Copy]);
    assert!(report.regions[2].elements == 1);
}

#[test]
fn coordinates_of_a_million_millimetres() {
    let ball = rough_ball(Point::origin(), 6.0, 0.1, 4);
    let shift = Motion::translation(1e6, -1e6, 1e6);
    let far = ball.moved(&shift);
    check(&far, &[]);
    // The fields agree up to the rounding of the vertices.
    for ((method, here, _), (_, there, _)) in
        fields(&ball, SPACING_MM, BAND_MM).iter().zip(&fields(&far, SPACING_MM, BAND_MM))
    {
        let mut random = Random(81);
        let mut largest = 0.0f64;
        for _ in 0..2000 {
            let p = random.point(Point::origin(), 8.0);
            largest = largest.max((here.value(&p) - there.value(&(shift * p))).abs());
        }
        assert!(largest < 1e-3, "{method:?}: {largest}");
    }
}

#[test]
fn an_empty_mesh_is_none() {
    assert!(matches!(TriMesh::new(vec![Point::origin()], vec![]), Err(GeometryError::Empty)));
}

#[test]
fn settings_and_coordinates_out_of_range_are_refused_before_anything_is_built() {
    let ball = sphere(Point::origin(), 6.0, 2);
    let far = ball.moved(&Motion::translation(1e200, 0.0, 0.0));
    let field = FieldSettings { spacing_mm: SPACING_MM, band_mm: BAND_MM, margin_mm: 4.0 };
    let usual = MethodSettings { field, resolution: Some(16), ..MethodSettings::default() };
    for method in Method::ALL {
        let refused = |mesh: &TriMesh, settings: MethodSettings| {
            let settings = MethodSettings { method, ..settings };
            let built = SignedField::build_only(mesh, &settings, &Control::new()).map(|_| ());
            assert_eq!(
                format!("{built:?}"),
                format!("{:?}", SignedField::build(mesh, &settings, &Control::new()).map(|_| ()))
            );
            match built {
                Err(FieldError::Setting { name, .. }) => name,
                other => panic!("{method:?}: {other:?}"),
            }
        };
        let with = |field: FieldSettings| MethodSettings { field, ..usual };
        // A margin that would turn the surface's box inside out.
        assert_eq!(refused(&ball, with(FieldSettings { margin_mm: -7.0, ..field })), "margin_mm");
        assert_eq!(refused(&ball, with(FieldSettings { margin_mm: f64::NAN, ..field })), "margin_mm");
        assert_eq!(refused(&ball, with(FieldSettings { band_mm: f64::INFINITY, ..field })), "band_mm");
        assert_eq!(refused(&ball, MethodSettings { resolution: Some(0), ..usual }), "resolution");
        let spacing = FieldSettings { spacing_mm: 0.0, ..field };
        assert_eq!(refused(&ball, MethodSettings { resolution: None, field: spacing, ..usual }), "spacing_mm");
        assert_eq!(refused(&far, usual), "largest coordinate");
    }
}
