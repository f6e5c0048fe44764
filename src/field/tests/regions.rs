use super::shapes::{Random, block, filtered, flipped, joined, rough_ball, sphere};
use crate::{ExactDistance, RegionKind, RegionsOfKind, unclear_regions};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, Vector};

fn found(mesh: &TriMesh) -> Vec<RegionsOfKind> {
    unclear_regions(mesh, &ExactDistance::new(mesh), &Control::new()).unwrap()
}

fn kinds(regions: &[RegionsOfKind]) -> Vec<RegionKind> {
    regions.iter().map(|r| r.kind).collect()
}

fn of(regions: &[RegionsOfKind], kind: RegionKind) -> &RegionsOfKind {
    regions.iter().find(|r| r.kind == kind).unwrap()
}

#[test]
fn closed_consistent_surfaces_have_none() {
    for seed in 0..4 {
        assert_eq!(found(&rough_ball(Point::new(1e3, 2.0, -5.0), 5.0, 0.25, seed)), []);
    }
    // A sphere with a cavity, and a surface of two parts.
    let hollow = joined(&sphere(Point::origin(), 7.0, 3), &flipped(&sphere(Point::origin(), 4.0, 3), |_| true));
    assert_eq!(found(&joined(&hollow, &block(Point::new(15.0, 0.0, 0.0), Vector::repeat(2.0)))), []);
}

#[test]
fn a_hole_has_its_rim_area_and_place() {
    let hole = Point::new(0.0, 0.0, 8.0);
    let bowl = filtered(&sphere(Point::origin(), 8.0, 4), |_, c| c.iter().any(|p| (p - hole).norm() > 3.0));
    let regions = found(&bowl);
    // The triangles next to the lid see it edge-on, so the winding numbers at their sides are clear.
    assert_eq!(kinds(&regions), [RegionKind::Open]);
    let open = &regions[0];
    assert_eq!((open.count, open.largest.len()), (1, 1));
    let missing = sphere(Point::origin(), 8.0, 4).area() - bowl.area();
    // A flat lid over a cap of radius 3 mm on a sphere of 8 mm is slightly smaller than the cap.
    assert!(open.area_mm2 < missing && open.area_mm2 > 0.9 * missing, "{} {missing}", open.area_mm2);
    let bounds = open.largest[0].bounds;
    assert!((bounds.center() - Point::new(0.0, 0.0, 7.4)).norm() < 0.3 && bounds.diagonal() < 9.0, "{bounds:?}");
}

#[test]
fn a_patch_and_a_part_that_look_the_other_way_are_inverted_with_their_place() {
    let place = Point::new(8.0, 0.0, 0.0);
    let ball = sphere(Point::origin(), 8.0, 4);
    let near = |c: [Point; 3]| c.iter().all(|p| (p - place).norm() < 2.0);
    let patch = flipped(&ball, |t| near(ball.corners(t)));
    let n = (0..ball.triangles().len()).filter(|&t| near(ball.corners(t))).count();
    let regions = found(&patch);
    let inverted = of(&regions, RegionKind::Inverted);
    assert_eq!((inverted.count, inverted.elements), (1, n));
    assert!((inverted.largest[0].bounds.center() - place).norm() < 0.3);
    // Nothing is open: the rim of the patch only counts twice.
    assert!(!kinds(&regions).contains(&RegionKind::Open));

    let beside = flipped(&block(Point::new(20.0, 0.0, 0.0), Vector::repeat(3.0)), |_| true);
    let regions = found(&joined(&ball, &beside));
    assert_eq!(kinds(&regions), [RegionKind::Inverted]);
    assert_eq!((regions[0].count, regions[0].elements), (1, 12));
    assert!((regions[0].area_mm2 - 6.0 * 36.0).abs() < 1e-9);
    assert!((regions[0].largest[0].bounds.center() - Point::new(20.0, 0.0, 0.0)).norm() < 1e-9);
}

#[test]
fn what_lies_within_another_part_is_buried_and_sheets_bound_nothing() {
    let crossing = joined(&sphere(Point::new(-3.0, 0.0, 0.0), 5.0, 4), &sphere(Point::new(3.0, 0.0, 0.0), 5.0, 4));
    let regions = found(&crossing);
    assert_eq!(kinds(&regions), [RegionKind::Buried]);
    assert_eq!(regions[0].count, 2);
    // Each cap inside the other sphere has the area 2π r (r - 3) = 62.8 mm².
    assert!((regions[0].area_mm2 / 125.7 - 1.0).abs() < 0.05, "{}", regions[0].area_mm2);

    let sheet = TriMesh::new(
        vec![Point::new(20.0, 0.0, 0.0), Point::new(26.0, 0.0, 0.0), Point::new(20.0, 6.0, 1.0)],
        vec![[0, 1, 2]],
    );
    let sheet = sheet.unwrap();
    // At its middle a triangle has the winding number one half on one side and minus one half on the other.
    assert_eq!(kinds(&found(&sheet)), [RegionKind::Open, RegionKind::Ambiguous]);
    let both = joined(&sheet, &flipped(&sheet, |_| true));
    assert_eq!(kinds(&found(&both)), [RegionKind::Copy]);
}

#[test]
fn copies_and_triangles_without_area_have_their_place() {
    let ball = block(Point::origin(), Vector::repeat(4.0));
    let mut triangles = ball.triangles().to_vec();
    triangles.extend([triangles[3], [3, 3, 1]]);
    let regions = found(&TriMesh::new(ball.positions().to_vec(), triangles).unwrap());
    assert_eq!(kinds(&regions), [RegionKind::Copy, RegionKind::NoArea]);
    assert_eq!([0, 1].map(|n: usize| (regions[n].count, regions[n].elements)), [(1, 1); 2]);
    assert_eq!(regions[1].area_mm2, 0.0);
    let edge = regions[1].largest[0].bounds;
    assert!(edge.contains(&ball.positions()[3]) && edge.contains(&ball.positions()[1]));
}

#[test]
fn many_regions_are_counted_and_the_largest_listed() {
    let mut random = Random(70);
    let many = (0..70).map(|n| {
        let center = Point::new(10.0 * f64::from(n), 0.0, 0.0);
        flipped(&block(center, Vector::repeat(0.5 + 3.0 * random.unit())), |_| true)
    });
    let regions = found(&many.reduce(|all, one| joined(&all, &one)).unwrap());
    assert_eq!((regions[0].count, regions[0].largest.len(), regions[0].elements), (70, 50, 840));
    assert!(regions[0].largest.windows(2).all(|w| w[0].area_mm2 >= w[1].area_mm2));
    let cancelled = Control::new();
    cancelled.cancel();
    let ball = sphere(Point::origin(), 5.0, 1);
    assert!(unclear_regions(&ball, &ExactDistance::new(&ball), &cancelled).is_err());
}
