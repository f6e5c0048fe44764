//! Tests of overlaps, gaps and warnings along paths.

use super::tests::{block, bone, box_distance, endless, run, run_all};
use super::*;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Severity, Vector};

#[test]
fn a_lifted_segment_opens_a_gap_and_a_lowered_one_overlaps() {
    let cut = run(&block(), &[endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0])]).unwrap();
    let follow_to = |x: f64, z: f64| {
        let plan = Plan { paths: vec![Path::new(1, vec![(1.0, Motion::translation(x, 0.0, z))]).unwrap()] };
        follow(&cut, &plan, &Control::new()).unwrap().remove(0)
    };
    // Segment 1 is the lower one.
    let apart = follow_to(0.0, -4.0);
    assert!((apart.max_displacement_mm - 4.0).abs() < 1e-12 && (apart.path_length_mm - 4.0).abs() < 1e-12);
    assert_eq!(apart.along.len(), 11);
    let end = apart.along[10];
    assert!(end.t == 1.0 && end.overlap_mm == 0.0 && (end.gap_mm - 4.0).abs() < 0.05, "{end:?}");
    // The face is 24 by 20 mm; half a spacing at its rim does not lie in the cut.
    assert!((23.0 * 19.0 * 4.0 * 0.99..480.0 * 4.0).contains(&end.gap_mm3) && end.overlap_mm3 < 1.0, "{end:?}");
    let half = apart.along[5];
    assert!((half.gap_mm3 / end.gap_mm3 - 0.5).abs() < 0.01, "{half:?}");
    let end = follow_to(0.0, 3.0).along[10];
    assert!((end.overlap_mm - 3.0).abs() < 0.1 && end.gap_mm < 1e-3, "{end:?}");
    assert!((end.overlap_mm3 / (480.0 * 3.0) - 1.0).abs() < 0.03, "{end:?}");
    let rest = apart.along[0];
    assert!(rest.overlap_mm3 < 5.0 && rest.gap_mm3 < 5.0, "{rest:?}");
    let PathSample { overlap_mm: overlap, gap_mm: gap, .. } = follow_to(5.0, 0.0).along[10];
    // Sliding: the cap that has left the other bone is 5 mm of 24, on average 2.5 mm away.
    assert!(overlap < 0.05 && (gap - 2.5 * 5.0 / 24.0).abs() < 0.1, "{overlap} {gap}");
}

/// A block of three: the upper part, the sawn one, and one that was only parted from it. Both lower ones go down together.
#[test]
fn bone_that_was_only_parted_has_no_cut_faces() {
    let saw = Cut::from(endless([0.0, 0.0, 18.2], [0.0, 0.0, 1.0]));
    let parting = Cut { purpose: Purpose::Separation, ..endless([0.0, 0.0, 8.2], [0.0, 0.0, 1.0]).into() };
    let gaps = |second: Cut| {
        let cut = run_all(&block(), &[saw.clone(), second]).unwrap();
        let bounded_by = |cuts: &[usize]| cut.segments.iter().find(|s| s.bounded_by == cuts).unwrap().id;
        let (middle, lower) = (bounded_by(&[0, 1]), bounded_by(&[1]));
        let down =
            |segment, by_mm: f64| Path::new(segment, vec![(1.0, Motion::translation(0.0, 0.0, -by_mm))]).unwrap();
        [[(middle, 4.0), (lower, 4.0)], [(middle, 1e-6), (lower, 4.0)]].map(|moves| {
            let paths = moves.into_iter().map(|(segment, by_mm)| down(segment, by_mm)).collect();
            let reports = follow(&cut, &Plan { paths }, &Control::new()).unwrap();
            [middle, lower].map(|id| reports.iter().find(|r| r.segment == id).unwrap().along[10].gap_mm)
        })
    };
    let [together, lower_alone] = gaps(parting.clone());
    assert!((together[0] - 4.0).abs() < 0.05 && together[1] == 0.0, "{together:?}");
    assert!(lower_alone[0] < 0.05 && lower_alone[1] == 0.0, "{lower_alone:?}");
    // Sawn in both places, the face that stays closed counts as half of the middle one's.
    let [together, lower_alone] = gaps(Cut { purpose: Purpose::Osteotomy, ..parting });
    assert!((together[0] - 2.0).abs() < 0.05 && together[1] < 0.05, "{together:?}");
    assert!((lower_alone[1] - 4.0).abs() < 0.05, "{lower_alone:?}");
}

#[test]
fn what_a_surgeon_should_look_at_is_said_with_place_and_size() {
    let mut cut = run(&block(), &[endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0])]).unwrap();
    cut.segments[0].name = Some("skull".to_owned());
    cut.segments[1].name = Some("maxilla".to_owned());
    let warnings = |motion: Motion| {
        let plan = Plan { paths: vec![Path::new(1, vec![(1.0, motion)]).unwrap()] };
        follow(&cut, &plan, &Control::new()).unwrap().remove(0).warnings
    };
    assert_eq!(warnings(Motion::translation(0.0, -4.0, -2.0)), []);
    // 4 mm up into a face of 24 by 20 mm.
    let driven_in = warnings(Motion::translation(0.0, 0.0, 4.0));
    let said = driven_in[0].message.split_whitespace().collect::<Vec<_>>();
    assert_eq!((driven_in.len(), driven_in[0].code, driven_in[0].severity), (1, "bone-overlap", Severity::Check));
    assert!(driven_in[0].message.starts_with("maxilla ends 4.0 mm deep in skull at ["), "{driven_in:?}");
    let mm3: f64 = said[said.iter().position(|w| *w == "mm³").unwrap() - 1].parse().unwrap();
    assert!((mm3 / (480.0 * 4.0) - 1.0).abs() < 0.05, "{driven_in:?}");
    // A depth that a saw and a file remove.
    let sawn = warnings(Motion::translation(0.0, 0.0, 1.5));
    assert_eq!((sawn[0].code, sawn[0].severity, sawn[0].action), ("bone-overlap", Severity::Info, ""));
    let far = warnings(Motion::translation(0.0, -60.0, -7.0));
    assert_eq!((far[0].code, far[0].severity), ("large-displacement", Severity::Check));
    assert!(far[0].message.contains("moves 60.4 mm at its furthest point"), "{far:?}");
    let there_and_back = vec![(0.5, Motion::translation(0.0, 0.0, -40.0)), (1.0, Motion::identity())];
    let plan = Plan { paths: vec![Path::new(1, there_and_back).unwrap()] };
    let on_the_way = follow(&cut, &plan, &Control::new()).unwrap().remove(0).warnings;
    assert!(on_the_way[0].message.contains("moves 40.0 mm at its furthest point"), "{on_the_way:?}");
    assert!(warnings(Motion::translation(0.0, 0.0, -7.0))[0].message.contains("end 7.0 mm apart"));
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector::z_axis(), 25f64.to_radians());
    let turned = warnings(Motion::from_parts(Vector::zeros().into(), turn));
    assert_eq!(turned[0].code, "large-rotation");
    assert!(turned[0].message.contains("turns by 25.0 degrees"), "{turned:?}");
}

#[test]
fn a_block_pushed_half_aside_overlaps_by_a_box_and_a_tilted_one_opens_a_wedge() {
    let cut = run(&block(), &[endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0])]).unwrap();
    let moved = |motion: Motion| {
        let plan = Plan { paths: vec![Path::new(1, vec![(1.0, motion)]).unwrap()] };
        follow(&cut, &plan, &Control::new()).unwrap().remove(0).along[10]
    };
    let end = moved(Motion::translation(7.0, -4.0, 2.5));
    assert!((end.overlap_mm3 / (17.0 * 16.0 * 2.5) - 1.0).abs() < 0.04, "{end:?}");
    // Turned down about the upper edge at x = -12: the gap is a wedge of 24 mm and 10°.
    let (edge, angle) = (Point::new(-12.0, 0.0, 12.2), 10f64.to_radians());
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector::y_axis(), angle);
    let tilt = Motion::from_parts((edge - turn * edge).into(), turn);
    let end = moved(tilt);
    let wedge = 20.0 * 0.5 * 24.0 * 24.0 * angle.tan();
    assert!((end.gap_mm3 / wedge - 1.0).abs() < 0.08, "{} {wedge}", end.gap_mm3);
}

#[test]
fn a_gap_is_between_cut_faces_and_not_below_a_roof_and_counts_the_slot() {
    let blocks = [([-12.0, -10.0, 0.0], [12.0, 10.0, 40.0]), ([-12.0, -10.0, 34.0], [40.0, 10.0, 40.0])];
    let roofed = bone([-12.0, -10.0, 0.0], [40.0, 10.0, 40.0], 1.0, |p| {
        blocks.iter().map(|(low, high)| box_distance(p, *low, *high)).fold(f64::INFINITY, f64::min)
    });
    let plane = endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0]);
    for kerf_mm in [0.0, 1.0] {
        let cut = run_all(&roofed, &[Cut { kerf_mm, ..plane.into() }]).unwrap();
        // Pushed aside by 8 mm of 24: the rest faces the roof, 22 mm above. Before, all of it faces the other face.
        for (x, down, width) in [(0.0, 0.0, 24.0), (0.0, 0.3, 24.0), (8.0, 0.5, 16.0)] {
            let paths = vec![Path::new(1, vec![(1.0, Motion::translation(x, 0.0, -down))]).unwrap()];
            let end = follow(&cut, &Plan { paths }, &Control::new()).unwrap().remove(0).along[10];
            let expected = width * 20.0 * (down + kerf_mm);
            // Half a spacing at every rim does not lie in the cut.
            assert!(
                (0.87 * expected - 1.0..1.03 * expected + 1.0).contains(&end.gap_mm3),
                "{kerf_mm} {x} {down}: {end:?} {expected}"
            );
            let aside = x * 0.5 * x / 24.0;
            assert!(
                (down + kerf_mm - 0.05..down + kerf_mm + aside + 0.05).contains(&end.gap_mm),
                "{kerf_mm} {x}: {end:?}"
            );
        }
    }
}

#[test]
fn paths_of_unknown_or_fixed_segments_are_refused() {
    let cut = run(&block(), &[endless([0.0, 0.0, 12.2], [0.0, 0.0, 1.0])]).unwrap();
    let path = |id| Path::new(id, vec![(1.0, Motion::translation(1.0, 0.0, 0.0))]).unwrap();
    for paths in [vec![path(0)], vec![path(2)], vec![path(1), path(1)]] {
        assert!(matches!(follow(&cut, &Plan { paths }, &Control::new()), Err(PlanError::Value { .. })));
    }
}
