//! Tests of polylines, surfaces and kerfs on blocks and balls.

use super::tests::{assert_closed, block, bone, box_distance, endless, run_all};
use super::*;
use prosopon_field::Envelope;
use prosopon_geometry::{Point, TriMesh, Vector};

fn polyline(points: &[[f64; 3]], direction: [f64; 3], depth_mm: f64) -> Cut {
    let points = points.iter().map(|p| Point::from(*p)).collect();
    CutShape::Polyline { points, direction: direction.into(), depth_mm }.into()
}

fn sum(osteotomy: &Osteotomy) -> f64 {
    osteotomy.segments.iter().map(|s| s.volume_mm3).sum::<f64>() + osteotomy.dropped_mm3
}

fn check(bone: &Envelope, osteotomy: &Osteotomy) {
    osteotomy.segments.iter().for_each(|s| assert_closed(&s.surface));
    let (sum, whole) = (sum(osteotomy), bone.surface.volume());
    assert!((sum / whole - 1.0).abs() < 5e-3, "{sum} of {whole}");
}

#[test]
fn a_bent_polyline_parts_a_block_as_its_line_does() {
    let bone = block();
    // A step seen from the front: 6 mm higher on the right half.
    let step = [[-14.0, -12.0, 10.3], [0.2, -12.0, 10.3], [0.2, -12.0, 16.3], [14.0, -12.0, 16.3]];
    let done = run_all(&bone, &[polyline(&step, [0.0, 1.0, 0.0], 24.0)]).unwrap();
    check(&bone, &done);
    let lower = done.segments.iter().min_by(|a, b| a.centroid.z.total_cmp(&b.centroid.z)).unwrap();
    let expected = 20.0 * (12.2 * 10.3 + 11.8 * 16.3);
    assert!((lower.volume_mm3 / expected - 1.0).abs() < 1e-2, "{} {expected}", lower.volume_mm3);
    // Half as deep it parts nothing.
    assert!(matches!(run_all(&bone, &[polyline(&step, [0.0, 1.0, 0.0], 12.0)]), Err(PlanError::NotParted { .. })));
}

#[test]
fn a_closed_polyline_takes_a_core_out() {
    let bone = block();
    let ring = [[-5.3, -5.2, 31.0], [5.3, -5.2, 31.0], [5.3, 5.2, 31.0], [-5.3, 5.2, 31.0], [-5.3, -5.2, 31.0]];
    let done = run_all(&bone, &[polyline(&ring, [0.0, 0.0, -1.0], 32.0)]).unwrap();
    check(&bone, &done);
    assert_eq!(done.segments.len(), 2);
    let core = &done.segments[1];
    assert!((core.volume_mm3 / (10.6 * 10.4 * 30.0) - 1.0).abs() < 2e-2, "{}", core.volume_mm3);
    assert!((core.centroid - Point::new(0.0, 0.0, 15.0)).norm() < 0.1);
}

/// Part of a sphere's surface as triangles, every other one turned.
fn bowl(centre: Point, radius: f64, polar_max: f64) -> TriMesh {
    let (rings, spokes) = (16u32, 40u32);
    let mut positions = vec![centre + Vector::new(0.0, 0.0, radius)];
    for r in 1..=rings {
        let polar = polar_max * f64::from(r) / f64::from(rings);
        for s in 0..spokes {
            let around = std::f64::consts::TAU * f64::from(s) / f64::from(spokes);
            let flat = radius * polar.sin();
            positions.push(centre + Vector::new(flat * around.cos(), flat * around.sin(), radius * polar.cos()));
        }
    }
    let at = |r: u32, s: u32| if r == 0 { 0 } else { 1 + (r - 1) * spokes + s % spokes };
    let mut triangles = Vec::new();
    for r in 0..rings {
        for s in 0..spokes {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            if r > 0 {
                triangles.push([at(r, s), at(r, s + 1), at(r + 1, s + 1)]);
            }
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

#[test]
fn a_curved_surface_cuts_a_lens_from_a_ball() {
    let bone = bone([-15.0; 3], [15.0; 3], 1.0, |p| p.coords.norm() - 15.0);
    // Two balls of 15 mm, 16 mm apart: the lens has the volume of two caps of 7 mm.
    let centre = Point::new(0.2, -0.1, -16.0);
    let done = run_all(&bone, &[CutShape::Surface(bowl(centre, 15.0, 1.2)).into()]).unwrap();
    check(&bone, &done);
    let cap = std::f64::consts::PI * 7.0 * 7.0 * (3.0 * 15.0 - 7.0) / 3.0;
    let lens = &done.segments[1];
    // The bowl's facets lie up to 0.15 mm inside the sphere.
    assert!((lens.volume_mm3 / (2.0 * cap) - 1.0).abs() < 0.03, "{} {}", lens.volume_mm3, 2.0 * cap);
    for p in lens.surface.positions().iter().filter(|p| (p.coords.norm() - 15.0).abs() > 0.7) {
        assert!(((p - centre).norm() - 15.0).abs() < 0.3, "{p}");
    }
}

#[test]
fn a_sheet_through_nodes_leaks_nowhere_however_its_triangles_are_turned() {
    let bone = block();
    // Nodes have z = -2.3 + k and x = -14.3 + i: the sheet lies in them, and its inner edges too.
    let (x, z) = (-14.3f64 + 14.0, -2.3f64 + 12.0);
    for turned in 0..16u32 {
        let positions = vec![
            Point::new(-20.0, -20.0, z),
            Point::new(x, -20.0, z),
            Point::new(20.0, -20.0, z),
            Point::new(-20.0, 20.0, z),
            Point::new(x, 20.0, z),
            Point::new(20.0, 20.0, z),
        ];
        let mut triangles = vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
        for (t, corners) in triangles.iter_mut().enumerate() {
            if turned >> t & 1 == 1 {
                corners.swap(0, 1);
            }
        }
        let sheet = TriMesh::new(positions, triangles).unwrap();
        let done = run_all(&bone, &[CutShape::Surface(sheet).into()]).unwrap();
        check(&bone, &done);
        let lower = &done.segments[1];
        assert!((lower.volume_mm3 / (480.0 * 9.7) - 1.0).abs() < 2e-2, "{}", lower.volume_mm3);
    }
}

#[test]
fn a_slot_takes_its_width_from_both_sides() {
    let bone = block();
    let unsawn = |z: f64| sum(&run_all(&bone, &[endless([0.0, 0.0, z], [0.0, 0.0, 1.0]).into()]).unwrap());
    for (kerf_mm, z) in [(0.4, 15.2), (0.7, 15.9), (1.0, 15.7), (2.0, 15.2), (3.3, 14.8)] {
        let plane = Cut { kerf_mm, ..endless([0.0, 0.0, z], [0.0, 0.0, 1.0]).into() };
        let wide = [[-20.0, -12.0, z], [20.0, -12.0, z]];
        let strip = Cut { kerf_mm, ..polyline(&wide, [0.0, 1.0, 0.0], 24.0) };
        for cut in [plane, strip] {
            let done = run_all(&bone, &[cut]).unwrap();
            done.segments.iter().for_each(|s| assert_closed(&s.surface));
            let gone = unsawn(z) - sum(&done);
            // The cross-section along the rim, 88 mm long, is accurate to a fraction of the spacing squared.
            assert!((gone - 480.0 * kerf_mm).abs() < 0.03 * 480.0 * kerf_mm + 0.15 * 88.0, "{kerf_mm} mm: {gone} mm³");
            let lower = done.segments.iter().min_by(|a, b| a.centroid.z.total_cmp(&b.centroid.z)).unwrap();
            let top = lower.surface.bounds().max.z;
            assert!((top - (z - 0.5 * kerf_mm)).abs() < 0.02, "{kerf_mm}: {top}");
        }
    }
}

#[test]
fn an_oblique_slot_has_its_width_too() {
    let bone = block();
    let normal = Vector::new(0.3, -0.2, 1.0).normalize();
    let plane = BoundedPlane { point: Point::new(0.3, 0.1, 15.2), normal, bounds: None };
    let done = run_all(&bone, &[Cut { kerf_mm: 1.5, ..plane.into() }]).unwrap();
    let gone = sum(&run_all(&bone, &[plane.into()]).unwrap()) - sum(&done);
    assert!((gone / (480.0 / normal.z * 1.5) - 1.0).abs() < 0.03, "{gone}");
}

#[test]
fn a_slot_that_leaves_nothing_is_refused_with_its_cut() {
    let bone = block();
    let slab = Cut { kerf_mm: 6.0, ..Cut::from(endless([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])).named("chin") };
    match run_all(&bone, &[slab]) {
        Err(PlanError::Cut { cut: 0, label, field: "kerf_mm", detail }) => {
            assert_eq!(label, "cut `chin`");
            assert!(detail.starts_with("a kerf of 6 mm would leave 0 mm³ of the "), "{detail}");
            assert!(detail.contains("mm³ of bone of one segment"), "{detail}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_part_that_was_apart_is_freed_at_a_point_and_a_joined_one_is_not() {
    let two = |p: &Point| {
        let skull = box_distance(p, [-10.0, -10.0, 15.0], [10.0, 10.0, 40.0]);
        skull.min(box_distance(p, [-10.0, -10.0, 0.0], [10.0, 10.0, 10.0]))
    };
    let bone = bone([-10.0, -10.0, 0.0], [10.0, 10.0, 40.0], 1.0, two);
    let free = |z: f64| Cut::from(CutShape::FreePart(Point::new(0.0, 0.0, z)));
    let done = run_all(&bone, &[free(-3.0)]).unwrap();
    check(&bone, &done);
    assert!((done.segments[1].volume_mm3 / 4000.0 - 1.0).abs() < 1e-2);
    assert!(done.warnings.is_empty(), "{:?}", done.warnings);
    // With the skull divided as well, the jaw is one of three segments.
    let done = run_all(&bone, &[endless([0.0, 0.0, 25.2], [0.0, 0.0, 1.0]).into(), free(5.0)]).unwrap();
    assert_eq!(done.segments.len(), 3);
    assert!(matches!(run_all(&bone, &[free(30.0)]), Err(PlanError::NotParted { .. })));
    match run_all(&bone, &[endless([0.0, 0.0, 25.2], [0.0, 0.0, 1.0]).into(), free(30.0)]) {
        Err(PlanError::Cut { cut, field, .. }) => assert_eq!((cut, field), (1, "free_part")),
        other => panic!("{other:?}"),
    }
}

/// Two blocks above each other, joined over a fifth of their width and by a thin column far from there; a separation parts only
/// the first.
#[test]
fn what_separations_leave_is_parted_where_it_is_thin_and_named() {
    let of = |half_mm: f64| {
        let distance = move |p: &Point| {
            let skull = box_distance(p, [-20.0, -10.0, 20.0], [20.0, 10.0, 40.0]);
            let jaw = box_distance(p, [-20.0, -10.0, 0.0], [20.0, 10.0, 14.0]);
            let joint = box_distance(p, [-20.0, -4.0, 10.0], [-12.0, 4.0, 24.0]);
            let streak = box_distance(p, [8.0, -half_mm, 10.0], [16.0, half_mm, 24.0]);
            skull.min(jaw).min(joint).min(streak)
        };
        bone([-20.0, -10.0, 0.0], [20.0, 10.0, 40.0], 1.0, distance)
    };
    let plane = BoundedPlane {
        point: Point::new(-16.0, 0.0, 17.2),
        normal: Vector::z(),
        bounds: Some((Vector::x(), 8.0, 8.0)),
    };
    let joint = Cut::from(plane).named("joint").parting(Point::new(0.0, 0.0, -100.0));
    let cuts = [joint.clone(), CutShape::FreePart(Point::new(0.0, 0.0, 4.0)).into()];
    let done = run_all(&of(2.0), &cuts).unwrap();
    check(&of(2.0), &done);
    assert_eq!(done.segments.len(), 2);
    // 40 x 20 x 14 mm, 3.2 mm of the joint's 64 mm² and up to 6 mm of the streak's 32.
    let jaw_mm3 = done.segments[1].volume_mm3;
    assert!((11_350.0..11_650.0).contains(&jaw_mm3), "{jaw_mm3}");
    let warning = done.warnings.first().unwrap();
    assert_eq!(warning.code, "bridges-parted");
    assert!(warning.message.contains("bridges of 32 mm²") && warning.message.contains("near (12"), "{warning}");
    // A bridge as wide as the neck of a condyle is not parted, nor any bridge when the separation has no `part`.
    assert!(matches!(
        run_all(&of(6.0), &cuts),
        Err(PlanError::Value { .. } | PlanError::Cut { .. } | PlanError::NotParted { .. })
    ));
    let plain = [Cut { part: None, ..joint }, cuts[1].clone()];
    assert!(matches!(
        run_all(&of(2.0), &plain),
        Err(PlanError::Value { .. } | PlanError::Cut { .. } | PlanError::NotParted { .. })
    ));
}
