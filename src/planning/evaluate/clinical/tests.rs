use super::super::nearest_bone::tests::block;
use super::*;
use crate::phantom::{head, surface_of};
use prosopon_geometry::Severity;

/// A face as an extruded profile: strips of 40 mm about x = 5, with known corners.
///
/// Corners from above, as (forward, up): forehead, root of the nose, pronasale, columella, subnasale, labrale superius, stomion,
/// labrale inferius, sublabiale, pogonion, menton, neck.
const CORNERS: [[f64; 2]; 12] = [
    [0.0, 60.0],
    [0.0, 40.0],
    [25.0, 0.0],
    [20.0, -10.0],
    [6.0, -13.0],
    [10.0, -26.0],
    [5.0, -34.0],
    [9.0, -42.0],
    [3.0, -54.0],
    [7.0, -70.0],
    [-5.0, -85.0],
    [-30.0, -84.0],
];
const MIDLINE: f64 = 5.0;

fn corner(i: usize) -> Point {
    Point::new(MIDLINE, -CORNERS[i][0], CORNERS[i][1])
}

/// The extruded skin, with `parted` as two pieces above and below stomion; straight pieces of about 1 mm.
fn face(parted: bool) -> TriMesh {
    let mut line: Vec<Point> = Vec::new();
    let mut splits = Vec::new();
    for i in 0..CORNERS.len() - 1 {
        let (a, b) = (corner(i), corner(i + 1));
        let n = (b - a).norm().ceil() as usize;
        line.extend((0..n).map(|k| a + (b - a) * (k as f64 / n as f64)));
        if i == 5 {
            splits.push(line.len());
        }
    }
    line.push(corner(CORNERS.len() - 1));
    let across: Vec<f64> = (0..=8).map(|k| MIDLINE - 21.0 + 5.0 * f64::from(k)).collect();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let pieces = if parted { vec![(0, splits[0] + 1), (splits[0], line.len())] } else { vec![(0, line.len())] };
    for (from, to) in pieces {
        let first = positions.len();
        let rows = to - from;
        for p in &line[from..to] {
            positions.extend(across.iter().map(|x| Point::new(*x, p.y, p.z)));
        }
        let node = |i: usize, j: usize| (first + i * across.len() + j) as u32;
        for (i, j) in (0..rows - 1).flat_map(|i| (0..across.len() - 1).map(move |j| (i, j))) {
            let [a, b, c, d] = [node(i, j), node(i, j + 1), node(i + 1, j + 1), node(i + 1, j)];
            triangles.extend([[a, c, b], [a, d, c]]);
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

fn moved(skin: &TriMesh, by: impl Fn(&Point) -> Vector) -> TriMesh {
    skin.with_positions(skin.positions().iter().map(|p| p + by(p)).collect()).unwrap()
}

fn hard_points() -> BTreeMap<String, Point> {
    [
        ("ans", [5.0, 8.0, -10.0]),
        ("a_point", [5.0, 10.0, -16.0]),
        ("incisor_upper", [5.0, 6.0, -36.0]),
        ("incisor_lower", [5.0, 8.0, -34.0]),
        ("b_point", [5.0, 8.0, -54.0]),
        ("pogonion", [5.0, 4.0, -70.0]),
        ("menton", [5.0, 14.0, -78.0]),
    ]
    .map(|(name, p)| (name.to_owned(), Point::from(p)))
    .into()
}

/// Upper and lower jaw; the edges of the incisors overlap by 2 mm, so that each lies nearer to the other jaw than to its own.
fn jaws() -> [TriMesh; 2] {
    [block([-20.0, 5.0, -35.0], [30.0, 50.0, -5.0]), block([-20.0, 3.0, -80.0], [30.0, 50.0, -35.5])]
}

fn of<'a>(points: &'a [NamedPoint], name: &str) -> &'a NamedPoint {
    points.iter().find(|p| p.name == name).unwrap_or_else(|| panic!("{name} is missing"))
}

fn measured(rest: &TriMesh, moved: &TriMesh, given: &[(String, Point)], motions: [Motion; 2]) -> Clinical {
    let (proposed, [upper, lower]) = (hard_points(), jaws());
    let bones = [MovedBone { surface: &upper, motion: motions[0] }, MovedBone { surface: &lower, motion: motions[1] }];
    let input = ClinicalInput { rest, moved, given, proposed: &proposed, midline_x_mm: MIDLINE, bones: &bones };
    clinical(&input, &Control::new()).unwrap()
}

#[test]
fn corners_of_a_drawn_profile_are_found_where_they_were_drawn() {
    let skin = face(false);
    let found = measured(&skin, &skin, &[], [Motion::identity(); 2]);
    let names = [
        ("pronasale", 2),
        (COLUMELLA, 3),
        ("subnasale", 4),
        ("labrale_superius", 5),
        ("stomion_superius", 6),
        ("stomion_inferius", 6),
        ("labrale_inferius", 7),
        ("sublabiale", 8),
        ("soft_pogonion", 9),
        ("soft_menton", 10),
    ];
    assert_eq!(found.soft.len(), names.len());
    for (name, i) in names {
        let p = of(&found.soft, name);
        // The line has a vertex at every corner.
        assert!((p.rest - corner(i)).norm() < 1e-9 && !p.is_given, "{name}: {} and {}", p.rest, corner(i));
    }
    let degrees = |a: usize, b: usize, c: usize| {
        let (u, v) = (corner(a) - corner(b), corner(c) - corner(b));
        u.angle(&v).to_degrees()
    };
    let near = |value: Option<BeforeAfter>, exact: f64| {
        let value = value.unwrap();
        assert!((value.before - exact).abs() < 1e-9 && value.before == value.after, "{value:?} {exact}");
    };
    near(found.nasolabial_deg, degrees(3, 4, 5));
    near(found.labiomental_deg, degrees(7, 8, 9));
    near(found.lip_gap_mm, 0.0);
    assert!(found.is_mouth_sealed);
    let [piece] = &found.profile[..] else { panic!("{} pieces", found.profile.len()) };
    assert!(piece.before == piece.after && piece.before.len() > 150);
}

#[test]
fn ratios_are_those_by_which_skin_and_bone_were_moved() {
    let skin = face(false);
    // The upper jaw goes 6 mm forward and 2 up, the lower stays; all skin takes half of it and 3 mm to the left, which is
    // across the motion of bone and does not count.
    let bone = Vector::new(0.0, -6.0, 2.0);
    let after = moved(&skin, |_| bone * 0.5 + Vector::x() * 3.0);
    let motions = [Motion::translation(0.0, -6.0, 2.0), Motion::translation(0.0, 0.4, 0.0)];
    let found = measured(&skin, &after, &[], motions);
    let ratio = |name: &str| *found.ratios.iter().find(|r| r.soft == name).unwrap();
    for (name, hard) in [("pronasale", "a_point"), ("subnasale", "a_point"), ("labrale_superius", "incisor_upper")] {
        let r = ratio(name);
        assert_eq!(r.hard, Some(hard));
        assert!((r.ratio.unwrap() - 0.5).abs() < 1e-12, "{r:?}");
    }
    // The lower incisor's edge lies behind the upper one, but it moves with its own jaw.
    for name in ["labrale_inferius", "sublabiale", "soft_pogonion", "soft_menton"] {
        match ratio(name).ratio {
            Err(NoRatio::Still(mm)) => assert!((mm - 0.4).abs() < 1e-12, "{name} {mm}"),
            other => panic!("{name}: {other:?}"),
        }
    }
    let tip = of(&found.soft, "pronasale").movement();
    assert!((tip - Vector::new(3.0, -3.0, 1.0)).norm() < 1e-12);
    assert!((of(&found.hard, "incisor_upper").movement() - bone).norm() < 1e-12);
    let input = ClinicalInput {
        rest: &skin,
        moved: &after,
        given: &[],
        proposed: &hard_points(),
        midline_x_mm: MIDLINE,
        bones: &[],
    };
    let without = clinical(&input, &Control::new()).unwrap();
    assert!(without.hard.is_empty() && without.ratios.iter().all(|r| r.ratio == Err(NoRatio::NoHardPoint)));
}

#[test]
fn a_given_point_is_followed_on_the_skin_and_the_others_go_by_it() {
    let skin = face(false);
    let lip = corner(5) + Vector::new(0.0, 0.0, -2.0);
    let given = [("labrale_superius".to_owned(), lip + Vector::new(3.0, -1.0, 0.0))];
    let after = moved(&skin, |p| Vector::new(0.0, 0.0, 0.1 * (p.z - lip.z)));
    let found = measured(&skin, &after, &given, [Motion::identity(); 2]);
    let point = of(&found.soft, "labrale_superius");
    assert!(point.is_given);
    // The foot of the perpendicular on the strip between the corners 5 and 6.
    let (from, along) = (corner(5), (corner(6) - corner(5)).normalize());
    let off = lip + Vector::new(0.0, -1.0, 0.0) - from;
    let foot = from + along * off.dot(&along) + Vector::x() * 3.0;
    assert!((point.rest - foot).norm() < 1e-9, "{} {foot}", point.rest);
    assert!((point.movement() - Vector::new(0.0, 0.0, 0.1 * (point.rest.z - lip.z))).norm() < 1e-9);
    assert!(!of(&found.soft, "subnasale").is_given);
}

#[test]
fn joined_lips_matter_where_the_jaws_move_apart() {
    let [forward, both] = [Motion::translation(0.0, -6.0, 0.0), Motion::translation(0.0, -5.2, 0.0)];
    let skin = face(false);
    let after = moved(&skin, |_| Vector::new(0.0, -2.0, 0.0));
    let warning = |skin: &TriMesh, motions| measured(skin, &after, &[], motions).joined_lips();
    let found = warning(&skin, [forward, Motion::identity()]).unwrap();
    assert_eq!((found.code, found.severity), ("joined-lips", Severity::Check));
    assert!(found.message.contains("moves by 6.0 mm and the lower one by 0.0 mm"), "{}", found.message);
    assert!(found.message.contains("the line between them moves by 2.0 mm"), "{}", found.message);
    assert_eq!(warning(&skin, [forward, both]), None, "both jaws move alike");
    let parted = face(true);
    let found = measured(&parted, &parted, &[], [forward, Motion::identity()]);
    assert_eq!(found.joined_lips(), None, "parted lips follow their own jaws");
}

#[test]
fn parted_lips_open_by_the_distance_that_their_margins_move_apart() {
    let skin = face(true);
    let stomion = corner(6).z;
    let found = measured(&skin, &skin, &[], [Motion::identity(); 2]);
    assert_eq!(found.lip_gap_mm, Some(BeforeAfter { before: 0.0, after: 0.0 }));
    assert_eq!(found.profile.len(), 2);
    let below: Vec<bool> = {
        // The second piece follows the first one's vertices.
        let first = skin.positions().iter().rposition(|p| p.z > stomion + 1e-9).unwrap_or(0) + 9;
        (0..skin.positions().len()).map(|v| v > first).collect()
    };
    let open = skin.positions().iter().zip(&below).map(|(p, below)| if *below { p - Vector::z() * 4.0 } else { *p });
    let open = skin.with_positions(open.collect()).unwrap();
    let found = measured(&skin, &open, &[], [Motion::identity(); 2]);
    let gap = found.lip_gap_mm.unwrap();
    assert!(gap.before == 0.0 && (gap.after - 4.0).abs() < 1e-9 && !found.is_mouth_sealed, "{gap:?}");
    for (name, i) in [("labrale_superius", 5), ("labrale_inferius", 7), ("sublabiale", 8), ("soft_pogonion", 9)] {
        assert!((of(&found.soft, name).rest - corner(i)).norm() < 1e-9, "{name}");
    }
    // Margins that overlap do not have a negative gap.
    let shut = skin.positions().iter().zip(&below).map(|(p, below)| if *below { p + Vector::z() } else { *p });
    let shut = skin.with_positions(shut.collect()).unwrap();
    assert_eq!(measured(&skin, &shut, &[], [Motion::identity(); 2]).lip_gap_mm.unwrap().after, 0.0);
}

#[test]
fn all_points_are_found_on_the_phantom_and_lie_on_its_skin() {
    let head = head();
    let sampled = |solid| surface_of(solid, &head.bounds(), 1.5).unwrap();
    let (skin, skull) = (sampled(head.skin.as_ref()), sampled(head.skull.as_ref()));
    let proposed = crate::plan::propose(&skin, &skull).points;
    let after = moved(&skin, |_| Vector::new(0.0, -2.0, 0.0));
    let bones = [MovedBone { surface: &skull, motion: Motion::translation(0.0, -4.0, 0.0) }];
    let given = &head.landmarks.points;
    let input =
        ClinicalInput { rest: &skin, moved: &after, given, proposed: &proposed, midline_x_mm: 0.0, bones: &bones };
    let found = clinical(&input, &Control::new()).unwrap();
    assert_eq!(found.soft.len(), SOFT.len() + 1);
    assert!(of(&found.soft, "pronasale").is_given && !of(&found.soft, "labrale_inferius").is_given);
    let heights: Vec<f64> = found.soft.iter().map(|p| p.rest.z).collect();
    assert!(heights.is_sorted_by(|a, b| a >= b), "{heights:?}");
    // By construction: the lips are ellipsoids with their foremost points at z = 8 and -5 that meet at z = 1.
    for (name, z) in [("labrale_superius", 8.0), ("labrale_inferius", -5.0), ("stomion_superius", 1.3)] {
        // Blended shapes; the extremum in front of a slanted line lies off that along an axis.
        assert!((of(&found.soft, name).rest.z - z).abs() < 3.0, "{name}: {}", of(&found.soft, name).rest);
    }
    for r in &found.ratios {
        assert!((r.ratio.unwrap() - 0.5).abs() < 1e-9, "{r:?}");
    }
}

#[test]
fn skins_with_other_triangles_are_refused() {
    let (one, other) = (face(false), face(true));
    let proposed = BTreeMap::new();
    let input =
        ClinicalInput { rest: &one, moved: &other, given: &[], proposed: &proposed, midline_x_mm: 5.0, bones: &[] };
    assert!(matches!(clinical(&input, &Control::new()), Err(EvaluateError::Input { .. })));
}

#[test]
fn given_points_far_from_skin_and_bone_are_left_out_by_name() {
    let skin = face(false);
    let after = moved(&skin, |_| Vector::new(0.0, -3.0, 0.0));
    let up = Vector::new(0.0, 0.0, 40.0);
    let given: Vec<(String, Point)> = [("pronasale", corner(2) + up), ("ans", Point::new(5.0, 8.0, -10.0) + up)]
        .map(|(name, p)| (name.to_owned(), p))
        .to_vec();
    let found = measured(&skin, &after, &given, [Motion::translation(0.0, -6.0, 0.0), Motion::identity()]);
    assert!(!found.soft.iter().any(|p| p.name == "pronasale") && !found.hard.iter().any(|p| p.name == "ans"));
    let names: Vec<&str> = found.left_out.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["ans", "pronasale"]);
    let warning = found.points_off_surface().unwrap();
    assert!(warning.code == "points-not-measured" && warning.message.contains("ans (35 mm)"), "{warning}");
    assert!(found.ratios.iter().any(|r| r.soft == "pronasale" && r.ratio == Err(NoRatio::NoSoftPoint)));
    // The others are still found, and nothing is reported of points within their accuracy.
    assert!(found.soft.iter().any(|p| p.name == "soft_pogonion"));
    let near = [("pronasale".to_owned(), corner(2) + Vector::new(0.0, -4.0, 0.0))];
    let found = measured(&skin, &after, &near, [Motion::identity(); 2]);
    assert!(of(&found.soft, "pronasale").is_given && found.points_off_surface().is_none());
}
