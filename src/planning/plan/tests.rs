//! Tests of cuts and paths on boxes and balls.

use std::collections::BTreeMap;

use super::*;
use prosopon_field::Envelope;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Point, ScalarGrid, Severity, TriMesh, Vector, isosurface};

/// Signed distance of an axis-aligned box.
pub(super) fn box_distance(p: &Point, low: [f64; 3], high: [f64; 3]) -> f64 {
    let d = Vector::from_fn(|a, _| (low[a] - p[a]).max(p[a] - high[a]));
    if d.max() <= 0.0 { d.max() } else { d.map(|c| c.max(0.0)).norm() }
}

pub(super) fn bone(low: [f64; 3], high: [f64; 3], spacing: f64, distance: impl Fn(&Point) -> f64) -> Envelope {
    // An odd margin, so that faces do not lie on nodes.
    let bounds = Aabb { min: low.into(), max: high.into() }.grown(2.3 * spacing);
    let mut grid = ScalarGrid::covering(&bounds, spacing, 0.0);
    for k in 0..grid.dims[2] {
        for j in 0..grid.dims[1] {
            for i in 0..grid.dims[0] {
                let index = grid.index(i, j, k);
                grid.values[index] = distance(&grid.position(i, j, k)) as f32;
            }
        }
    }
    let surface = isosurface(&grid, 0.0).unwrap();
    Envelope { grid, surface, warnings: vec![], regions: vec![] }
}

pub(super) fn block() -> Envelope {
    let (low, high) = ([-12.0, -10.0, 0.0], [12.0, 10.0, 30.0]);
    bone(low, high, 1.0, |p| box_distance(p, low, high))
}

pub(super) fn endless(point: [f64; 3], normal: [f64; 3]) -> BoundedPlane {
    BoundedPlane { point: point.into(), normal: Vector::from(normal).normalize(), bounds: None }
}

/// A horizontal rectangle over [x0, x1] and [y0, y1].
fn level(z: f64, x: [f64; 2], y: [f64; 2]) -> BoundedPlane {
    let middle = |r: [f64; 2]| 0.5 * (r[0] + r[1]);
    let half = |r: [f64; 2]| 0.5 * (r[1] - r[0]);
    let point = Point::new(middle(x), middle(y), z);
    BoundedPlane { point, normal: Vector::z(), bounds: Some((Vector::x(), half(x), half(y))) }
}

pub(super) fn run(bone: &Envelope, cuts: &[BoundedPlane]) -> Result<Osteotomy, PlanError> {
    run_all(bone, &cuts.iter().copied().map(Cut::from).collect::<Vec<_>>())
}

pub(super) fn run_all(bone: &Envelope, cuts: &[Cut]) -> Result<Osteotomy, PlanError> {
    cut(bone, cuts, &Control::new())
}

pub(super) fn assert_closed(mesh: &TriMesh) {
    let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
    for t in mesh.triangles() {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            *edges.entry((a, b)).or_default() += 1;
        }
    }
    assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)));
}

#[test]
fn an_oblique_plane_parts_a_block_into_closed_solids_with_planar_caps() {
    let bone = block();
    let plane = endless([0.3, 0.1, 12.2], [0.3, -0.2, 1.0]);
    let cut = run(&bone, &[plane]).unwrap();
    assert_eq!(cut.segments.len(), 2);
    assert!(cut.warnings.is_empty(), "{:?}", cut.warnings);
    let whole = bone.surface.volume();
    let sum: f64 = cut.segments.iter().map(|s| s.volume_mm3).sum();
    assert!((sum / whole - 1.0).abs() < 5e-3, "{sum} of {whole}");
    // The part below the plane: area of the base times the height of the plane above its centre.
    let expected = 24.0 * 20.0 * (12.2 + 0.3 * 0.3 - 0.2 * 0.1);
    let below = cut.segments.iter().min_by(|a, b| a.centroid.z.total_cmp(&b.centroid.z)).unwrap();
    assert!((below.volume_mm3 / expected - 1.0).abs() < 1e-2, "{} {expected}", below.volume_mm3);
    assert_eq!(below.id, 1);
    for s in &cut.segments {
        assert_closed(&s.surface);
        assert_eq!(s.bounded_by, [0]);
        assert!((s.volume_mm3 - s.surface.volume()).abs() < 1e-9);
        // No vertex is beyond the plane by more than the isosurface's nudge.
        let side = if s.id == 1 { 1.0 } else { -1.0 };
        let beyond = s.surface.positions().iter().map(|p| side * plane.normal.dot(&(p - plane.point)));
        assert!(beyond.fold(f64::MIN, f64::max) < 0.011);
    }
    // Caps of both: the same vertices, all of them in the plane.
    let cap = |s: &Segment| {
        let on = |p: &&Point| plane.normal.dot(&(**p - plane.point)).abs() < 0.011;
        let mut on: Vec<[u64; 3]> = s
            .surface
            .positions()
            .iter()
            .filter(on)
            .map(|p| [p.x, p.y, p.z].map(|c| (c * 1e6).round() as u64))
            .collect();
        on.sort_unstable();
        on
    };
    let (a, b) = (cap(&cut.segments[0]), cap(&cut.segments[1]));
    let common = a.iter().filter(|v| b.binary_search(v).is_ok()).count();
    assert!(common > 400 && common * 100 > 99 * a.len().max(b.len()), "{common} of {} and {}", a.len(), b.len());
}

#[test]
fn a_cut_through_nodes_gives_both_sides_their_volume() {
    let bone = block();
    // Nodes have z = -2.3 + k.
    let cut = run(&bone, &[endless([0.0, 0.0, 9.7], [0.0, 0.0, 1.0])]).unwrap();
    let lower = &cut.segments[1];
    // Edges of the block are rounded at the grid's spacing.
    assert!((lower.volume_mm3 / (24.0 * 20.0 * 9.7) - 1.0).abs() < 2e-2, "{}", lower.volume_mm3);
    assert!((lower.centroid - Point::new(0.0, 0.0, 4.85)).norm() < 0.05, "{}", lower.centroid);
}

#[test]
fn the_surface_of_a_ball_stays_in_place_beside_a_cut() {
    let bone = bone([-15.0; 3], [15.0; 3], 1.0, |p| p.coords.norm() - 15.0);
    let plane = endless([0.0, 0.0, 2.2], [0.1, 0.5, 1.0]);
    let cut = run(&bone, &[plane]).unwrap();
    let sum: f64 = cut.segments.iter().map(|s| s.volume_mm3).sum();
    // The cross-section along the rim, 94 mm long, loses a fraction of the spacing squared.
    assert!((sum / bone.surface.volume() - 1.0).abs() < 3e-3);
    for s in &cut.segments {
        for p in s.surface.positions() {
            let off = (p.coords.norm() - 15.0).abs();
            let in_plane = plane.normal.dot(&(p - plane.point)).abs() < 0.011;
            assert!(in_plane || off < 0.6, "{p} is {off} mm off the ball");
        }
    }
}

#[test]
fn bounded_cuts_take_a_corner_out_and_leave_the_rest() {
    let bone = block();
    // The corner x > 2, z < 8: two rectangles that overlap a little at their common edge.
    let side =
        BoundedPlane { point: Point::new(2.2, 0.0, 3.5), normal: Vector::x(), bounds: Some((Vector::y(), 14.0, 5.2)) };
    let cut = run(&bone, &[level(8.2, [1.5, 14.0], [-14.0, 14.0]), side]).unwrap();
    assert_eq!(cut.segments.len(), 2);
    let corner = &cut.segments[1];
    assert!((corner.volume_mm3 / (9.8 * 20.0 * 8.2) - 1.0).abs() < 2e-2, "{}", corner.volume_mm3);
    assert_eq!(corner.bounded_by, [0, 1]);
    assert_eq!(cut.segment_near(&Point::new(8.0, 0.0, 3.0)), Some(1));
    assert_eq!(cut.segment_near(&Point::new(8.0, 0.0, 20.0)), Some(0));
    assert_eq!(cut.segment_near(&Point::new(20.0, 0.0, 3.0)), Some(1));
}

#[test]
fn bridges_are_counted_and_the_widest_is_found() {
    let bone = block();
    // Bone from x = -12 to 12: 3 mm are left at the low end, 6 at the high.
    let short = level(15.2, [-9.0, 6.0], [-11.0, 11.0]);
    let bridges = left(run(&bone, &[short]));
    assert_eq!(bridges.len(), 2, "{bridges:?}");
    for (bridge, x, width) in [(&bridges[0], 6.0..12.0, 6.0), (&bridges[1], -12.0..-9.0, 3.0)] {
        assert!(x.contains(&bridge.place.x) && (bridge.place.z - 15.2).abs() < 1.0, "{bridge}");
        // Whole grid edges are counted.
        assert!((bridge.width_mm - width).abs() < 1.01 && (bridge.length_mm - 20.0).abs() < 1.01, "{bridge}");
        assert!((bridge.area_mm2 / (20.0 * width) - 1.0).abs() < 0.25, "{bridge}");
    }
}

fn left(done: Result<Osteotomy, PlanError>) -> Vec<Bridge> {
    match done {
        Err(PlanError::NotParted { bridges }) => bridges,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_bridge_of_a_thin_post_elsewhere_is_found_there() {
    // Two slabs on a thick pillar, sawn through, and a post of 4 mm by 6 mm.
    let shape = |p: &Point| {
        let slabs =
            box_distance(p, [0.0; 3], [40.0, 20.0, 8.0]).min(box_distance(p, [0.0, 0.0, 22.0], [40.0, 20.0, 30.0]));
        let pillar = box_distance(p, [0.0, 0.0, 0.0], [14.0, 20.0, 30.0]);
        slabs.min(pillar).min(box_distance(p, [30.0, 7.0, 0.0], [34.0, 13.0, 30.0]))
    };
    let bone = bone([0.0; 3], [40.0, 20.0, 30.0], 1.0, shape);
    let cut = level(15.0, [-1.0, 20.0], [-1.0, 21.0]);
    let bridges = left(run(&bone, &[cut]));
    let [bridge] = &bridges[..] else { panic!("{bridges:?}") };
    assert!((bridge.place.x - 32.0).abs() < 2.5 && (bridge.place.y - 10.0).abs() < 3.5, "{bridge}");
    assert!((bridge.width_mm - 4.0).abs() < 1.01 && (bridge.length_mm - 6.0).abs() < 1.01, "{bridge}");
}

#[test]
fn a_cut_that_has_barely_begun_goes_on_straight() {
    let bridges = left(run(&block(), &[level(15.2, [-13.0, -8.0], [-11.0, 11.0])]));
    let [bridge] = &bridges[..] else { panic!("{bridges:?}") };
    // 4 of 24 mm are sawn: 20 by 20 mm are left, round (2, 0, 15.2).
    assert!((bridge.place - Point::new(2.0, 0.0, 15.2)).norm() < 1.5, "{bridge}");
    assert!((bridge.width_mm - 20.0).abs() < 1.5 && (bridge.area_mm2 / 400.0 - 1.0).abs() < 0.15, "{bridge}");
}

#[test]
fn an_l_shape_is_not_parted_by_a_cut_that_stops_short_in_one_leg() {
    let leg = |p: &Point| {
        let upright = box_distance(p, [0.0, 0.0, 0.0], [10.0, 10.0, 40.0]);
        let foot = box_distance(p, [0.0, 0.0, 0.0], [40.0, 10.0, 10.0]);
        upright.min(foot)
    };
    let bone = bone([0.0; 3], [40.0, 10.0, 40.0], 1.0, leg);
    let bridges = left(run(&bone, &[level(25.0, [-2.0, 7.0], [-2.0, 12.0])]));
    assert_eq!(bridges.len(), 1);
    let Point { coords } = bridges[0].place;
    assert!((7.0..10.0).contains(&coords.x) && (0.0..10.0).contains(&coords.y) && (coords.z - 25.0).abs() < 1.0);
    assert_eq!(run(&bone, &[level(25.0, [-2.0, 12.0], [-2.0, 12.0])]).unwrap().segments.len(), 2);
}

#[test]
fn a_bounded_cut_beside_the_bone_misses_it_by_its_distance() {
    let bone = block();
    match run(
        &bone,
        &[
            endless([0.0, 0.0, 9.0], [0.0, 0.0, 1.0]),
            level(15.0, [17.0, 30.0], [-10.0, 10.0]),
            level(99.0, [-9.0, 9.0], [-9.0, 9.0]),
        ],
    ) {
        Err(PlanError::MissesBone { missed_by }) => {
            assert_eq!(missed_by.iter().map(|m| m.cut).collect::<Vec<_>>(), [1, 2]);
            assert!((missed_by[0].distance_mm - 5.0).abs() < 0.1, "{missed_by:?}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn parts_that_were_apart_stay_unless_a_cut_divides_them() {
    let two = |p: &Point| {
        let skull = box_distance(p, [-10.0, -10.0, 15.0], [10.0, 10.0, 40.0]);
        let jaw = box_distance(p, [-10.0, -10.0, 0.0], [10.0, 10.0, 10.0]);
        skull.min(jaw)
    };
    let bone = bone([-10.0, -10.0, 0.0], [10.0, 10.0, 40.0], 1.0, two);
    let cut = run(&bone, &[endless([0.0, 0.0, 20.0], [0.0, 0.0, 1.0])]).unwrap();
    assert_eq!(cut.segments.len(), 2);
    assert!((cut.segments[0].volume_mm3 / (400.0 * 30.0) - 1.0).abs() < 1e-2);
    // Only the jaw is divided: the skull is fixed, both pieces of the jaw may move.
    let cut = run(&bone, &[level(4.0, [-12.0, 12.0], [-12.0, 12.0])]).unwrap();
    let volumes: Vec<f64> = cut.segments.iter().map(|s| s.volume_mm3 / 400.0).collect();
    assert!(volumes.iter().zip([25.0, 6.0, 4.0]).all(|(v, e)| (v / e - 1.0).abs() < 2e-2), "{volumes:?}");
}

#[test]
fn fragments_stay_with_a_neighbour_with_a_warning_and_do_not_count_as_a_parting() {
    let bone = block();
    let corner = endless([12.0, 10.0, 24.0], [1.0, 1.0, 1.0]);
    assert!(matches!(run(&bone, &[corner]), Err(PlanError::NotParted { .. })));
    let cut = run(&bone, &[corner, endless([0.0, 0.0, 9.0], [0.0, 0.0, 1.0])]).unwrap();
    assert_eq!(cut.segments.len(), 2);
    let codes: Vec<&str> = cut.warnings.iter().map(|w| w.code).collect();
    assert_eq!(codes, ["fragments-kept", "cut-parts-little"], "{:?}", cut.warnings);
    let warning = &cut.warnings[0];
    assert_eq!((warning.code, warning.severity), ("fragments-kept", Severity::Info));
    assert!(warning.message.starts_with("1 fragments of "), "{warning}");
}

/// One plane twice with opposite normals: grid nodes that lie in it form a sheet between the two. Elsewhere it acts as one cut.
#[test]
fn a_plane_given_twice_makes_no_sheet_of_bone() {
    let bone = block();
    let grid = &bone.grid;
    let mut refused = 0;
    for layer in 0..grid.dims[2] {
        let z = grid.position(0, 0, layer).z;
        if !(8.0..16.0).contains(&z) {
            continue;
        }
        for height in [z, z + 0.3 * grid.spacing] {
            let plane = |up: f64| endless([0.0, 0.0, height], [0.0, 0.0, up]);
            match run(&bone, &[plane(1.0), plane(-1.0)]) {
                Ok(cut) => assert_eq!(cut.segments.len(), 2, "{height}"),
                Err(PlanError::Cut { cut: 1, label, field: "", detail }) => {
                    assert_eq!(label, "cut 1");
                    assert!(detail.contains("thick to cut 0; remove one"), "{detail}");
                    refused += 1;
                }
                Err(other) => panic!("{height}: {other}"),
            }
        }
    }
    assert!(refused > 0);
}

#[test]
fn faulty_cuts_are_refused_by_name() {
    let bone = block();
    let good = level(15.0, [-20.0, 20.0], [-20.0, 20.0]);
    let what = |cuts: &[BoundedPlane]| match run(&bone, cuts) {
        Err(PlanError::Cut { cut, field, .. }) => (cut, field),
        other => panic!("{other:?}"),
    };
    assert!(matches!(run(&bone, &[]), Err(PlanError::Value { what, .. }) if what == "cuts"));
    assert_eq!(what(&[good, BoundedPlane { normal: Vector::zeros(), ..good }]), (1, "plane.normal"));
    assert_eq!(what(&[BoundedPlane { point: Point::new(f64::NAN, 0.0, 0.0), ..good }]), (0, "plane.point_mm"));
    assert_eq!(what(&[BoundedPlane { bounds: Some((Vector::z(), 1.0, 1.0)), ..good }]), (0, "plane.bounds"));
    assert_eq!(what(&[BoundedPlane { bounds: Some((Vector::x(), -1.0, 1.0)), ..good }]), (0, "plane.bounds"));
    let control = Control::new();
    control.cancel();
    assert!(matches!(cut(&bone, &[good.into()], &control), Err(PlanError::Cancelled(_))));
}

#[test]
fn templates_of_both_jaws_part_the_teeth_in_one_plane() {
    let bone = block_head(true);
    let at = |x: f64, y: f64, z: f64| Point::new(x, y, z);
    let points = [
        ("lingula_left", at(42.0, -17.0, 20.0)),
        ("lingula_right", at(-42.0, -17.0, 20.0)),
        ("molar_left", at(30.0, -45.0, 10.0)),
        ("molar_right", at(-30.0, -45.0, 10.0)),
    ];
    let landmarks = Landmarks {
        points: points.map(|(name, p)| (name.to_owned(), p)).into(),
        midline_x_mm: Some(0.0),
        occlusal_z_mm: Some(17.5),
        le_fort_1_plane: Some((at(0.0, -60.0, 37.0), Vector::new(0.04, -0.1, 1.0))),
    };
    let templates = [Template::LeFort1, Template::BssoLeft, Template::BssoRight];
    let cuts: Vec<Cut> = templates.iter().flat_map(|t| t.cuts(&landmarks, &bone).unwrap()).collect();
    let planes: Vec<BoundedPlane> = cuts
        .iter()
        .filter(|c| c.name.as_deref().is_some_and(|n| n.starts_with("occlusal")))
        .filter_map(|c| match &c.shape {
            CutShape::Plane(plane) => Some(*plane),
            CutShape::Polyline { .. } | CutShape::Surface(_) | CutShape::FreePart(_) => None,
        })
        .collect();
    assert!(planes.len() >= 3, "{}", planes.len());
    for plane in &planes {
        assert!((plane.normal - planes[0].normal).norm() < 1e-12, "{plane:?}");
        assert!((plane.point - planes[0].point).dot(&plane.normal).abs() < 1e-9, "{plane:?}");
    }
    // Without the Le Fort I plane the occlusal plane is horizontal.
    let level = Landmarks { le_fort_1_plane: None, ..landmarks };
    let cuts = Template::BssoLeft.cuts(&level, &bone).unwrap();
    let occlusal = cuts.iter().find(|c| c.name.as_deref() == Some("occlusal")).unwrap();
    assert!(matches!(&occlusal.shape, CutShape::Plane(p) if p.normal == Vector::z() && p.point.z == 17.5));
}

/// Blocks for a cranium, a dental arch, pterygoid plates and a jaw that is joined to the arch by its teeth.
fn block_head(joined_teeth: bool) -> Envelope {
    let jaw_top = if joined_teeth { 19.0 } else { 12.0 };
    let blocks = [
        ([-50.0, -85.0, 40.0], [50.0, 0.0, 60.0]),
        ([-30.0, -80.0, 17.0], [30.0, -30.0, 42.0]),
        ([-19.0, -32.0, 22.0], [-13.0, -22.0, 42.0]),
        ([13.0, -32.0, 22.0], [19.0, -22.0, 42.0]),
        ([-30.0, -80.0, -20.0], [30.0, -40.0, jaw_top]),
        ([-50.0, -45.0, -20.0], [50.0, -20.0, -5.0]),
        ([-50.0, -24.0, -20.0], [-42.0, -10.0, 42.0]),
        ([42.0, -24.0, -20.0], [50.0, -10.0, 42.0]),
    ];
    bone([-50.0, -85.0, -20.0], [50.0, 0.0, 60.0], 1.5, |p| {
        blocks.iter().map(|(low, high)| box_distance(p, *low, *high)).fold(f64::INFINITY, f64::min)
    })
}

#[test]
fn le_fort_1_frees_the_upper_arch_and_nothing_else() {
    // With teeth apart there is nothing to saw at the occlusal plane: that cut is left out.
    for (joined, occlusal, n_cuts, low) in [(true, 17.5, 3, 17.5), (false, 14.0, 2, 17.0)] {
        let bone = block_head(joined);
        let cuts = le_fort_1((Point::new(0.0, -60.0, 37.0), Vector::z()), 0.0, occlusal, [None; 2], &bone);
        assert_eq!(cuts.len(), n_cuts);
        let osteotomy = run_all(&bone, &cuts).unwrap();
        assert_eq!(osteotomy.segments.len(), 2);
        let (maxilla, expected) = (&osteotomy.segments[1], 60.0 * 50.0 * (37.0 - low));
        assert!((maxilla.volume_mm3 / expected - 1.0).abs() < 0.04, "{} {expected}", maxilla.volume_mm3);
        let middle = Point::new(0.0, -55.0, 0.5 * (37.0 + low));
        assert!((maxilla.centroid - middle).norm() < 1.0, "{}", maxilla.centroid);
    }
    let bone = block_head(false);
    let tilted = Vector::new(0.05, -0.1, -1.0);
    let cuts = le_fort_1((Point::new(9.0, -60.0, 37.0), tilted), 0.0, 14.0, [None; 2], &bone);
    assert_eq!(run_all(&bone, &cuts).unwrap().segments.len(), 2);
    assert!(le_fort_1((Point::origin(), Vector::x()), 0.0, -20.0, [None; 2], &bone).is_empty());
}
