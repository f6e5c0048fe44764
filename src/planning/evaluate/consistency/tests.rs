//! The phantom in other frames, poses and units: what is found, and that nothing is found where nothing is wrong.

use std::sync::OnceLock;

use super::*;
use crate::phantom::{head, head_with_mouth, surface_of};
use crate::plan::propose;
use prosopon_geometry::{Motion, Point, Severity, TriMesh, Vector, Warning};

struct Head {
    skin: TriMesh,
    skull: TriMesh,
    points: Vec<(String, Point)>,
}

/// The phantom at another place than the origin, so that a turn about z is not a turn about its own middle.
fn phantom() -> &'static Head {
    static HEAD: OnceLock<Head> = OnceLock::new();
    HEAD.get_or_init(|| {
        let head = head_with_mouth();
        let at = Motion::translation(14.0, -20.0, 9.0);
        let surface = |solid| surface_of(solid, &head.bounds(), 3.0).unwrap().moved(&at);
        let (skin, skull) = (surface(head.skin.as_ref()), surface(head.skull.as_ref()));
        let points = head.landmarks.points.iter().map(|(name, p)| (name.clone(), at * p)).collect();
        Head { skin, skull, points }
    })
}

fn changed(mesh: &TriMesh, change: impl Fn(&Point) -> Point) -> TriMesh {
    mesh.with_positions(mesh.positions().iter().map(change).collect()).unwrap()
}

fn ras(p: &Point) -> Point {
    Point::new(-p.x, -p.y, p.z)
}

fn mirrored(p: &Point) -> Point {
    Point::new(-p.x, p.y, p.z)
}

/// Tilts by 15° about each axis.
fn tilts() -> Vec<Motion> {
    let turn = |axis: usize, deg: f64| Motion::rotation(Vector::ith(axis, deg.to_radians()));
    let mut all: Vec<Motion> = (0..3).flat_map(|axis| [turn(axis, 15.0), turn(axis, -15.0)]).collect();
    all.push(turn(0, 10.0) * turn(1, 10.0) * turn(2, 10.0));
    all.push(turn(0, 30.0));
    // A head on its side, and one that looks up.
    all.push(turn(2, 90.0));
    all.push(turn(0, 90.0));
    all
}

fn codes(warnings: &[Warning]) -> Vec<&'static str> {
    warnings.iter().map(|w| w.code).collect()
}

fn of(points: &[(String, Point)], skin: Option<&TriMesh>, skull: Option<&TriMesh>) -> Vec<Warning> {
    check_landmarks(&GivenLandmarks { points, unconfirmed: &[], midline_x_mm: None }, skin, skull).unwrap()
}

fn moved(points: &[(String, Point)], change: impl Fn(&Point) -> Point) -> Vec<(String, Point)> {
    points.iter().map(|(name, p)| (name.clone(), change(p))).collect()
}

#[test]
fn landmarks_in_another_frame_unit_or_place_are_reported_with_the_cause() {
    let head = phantom();
    type Case = (&'static str, fn(&Point) -> Point, &'static str, &'static str);
    let cases: [Case; 8] = [
        ("RAS", ras, "landmarks-wrong-frame", "RAS and LPS"),
        ("mirrored", mirrored, "landmarks-wrong-frame", "mirrored in x"),
        ("front and back", |p| Point::new(p.x, -p.y, p.z), "landmarks-wrong-frame", "mirrored in y"),
        ("cm", |p| p * 0.1, "landmarks-wrong-frame", "multiplied by 10 "),
        ("inches", |p| p / 25.4, "landmarks-wrong-frame", "multiplied by 25.4"),
        ("µm", |p| p * 1000.0, "landmarks-wrong-frame", "divided by 1000"),
        ("40 mm too high", |p| p + Vector::new(0.0, 0.0, 40.0), "landmarks-wrong-frame", "shifted by (0, 0, -40)"),
        ("900 mm aside", |p| p + Vector::new(900.0, 0.0, 0.0), "landmarks-wrong-frame", "shifted by (-900, 0, 0)"),
    ];
    for (name, change, code, text) in cases {
        let found = of(&moved(&head.points, change), Some(&head.skin), Some(&head.skull));
        assert_eq!(codes(&found), [code], "{name}: {found:?}");
        assert!(found[0].message.contains(text), "{name}: {found:?}");
        assert!(found[0].severity == Severity::Unreliable && found[0].message.contains(" mm from the "), "{found:?}");
    }
}

/// Six points, most of which stay near a smooth face when they are shifted along it.
#[test]
fn few_landmarks_shifted_along_the_face_are_reported() {
    let head = phantom();
    let names = ["pogonion", "menton", "ans", "nasal_bone_tip", "pronasale", "soft_pogonion"];
    let few: Vec<(String, Point)> =
        head.points.iter().filter(|(name, _)| names.contains(&name.as_str())).cloned().collect();
    assert!(few.len() >= 5, "{few:?}");
    assert!(of(&few, Some(&head.skin), Some(&head.skull)).is_empty());
    for mm in [-40.0, -25.0, 25.0, 40.0, 60.0] {
        let found = of(&moved(&few, |p| p + Vector::z() * mm), Some(&head.skin), Some(&head.skull));
        assert_eq!(codes(&found), ["landmarks-wrong-frame"], "{mm}: {found:?}");
    }
}

#[test]
fn another_patient_fits_in_no_way() {
    let head = phantom();
    // A head of another shape elsewhere: narrower, longer, turned.
    let turn = Motion::rotation(Vector::new(0.0, 0.5, 0.4));
    let other = |p: &Point| turn * Point::new(0.7 * p.x + 30.0, 1.1 * p.y + 25.0, 1.3 * p.z + 31.0);
    let found = of(&moved(&head.points, other), Some(&head.skin), Some(&head.skull));
    assert_eq!(codes(&found), ["landmarks-off-surface"], "{found:?}");
    assert!(found[0].severity == Severity::Unreliable && found[0].message.contains("no likely"), "{found:?}");
}

#[test]
fn exchanged_sides_are_found_with_surfaces_and_without() {
    let head = phantom();
    let exchange = |only: &str| -> Vec<(String, Point)> {
        let other = |name: &str| match (name.strip_suffix("_left"), name.strip_suffix("_right")) {
            _ if !name.starts_with(only) => name.to_owned(),
            (Some(stem), _) => format!("{stem}_right"),
            (_, Some(stem)) => format!("{stem}_left"),
            (None, None) => name.to_owned(),
        };
        head.points.iter().map(|(name, p)| (other(name), *p)).collect()
    };
    for (only, severity) in [("", Severity::Unreliable), ("orbitale", Severity::Check)] {
        for (skin, skull) in [(Some(&head.skin), Some(&head.skull)), (None, None)] {
            let found = of(&exchange(only), skin, skull);
            assert_eq!(codes(&found), ["landmarks-sides-exchanged"], "{found:?}");
            assert!(found[0].severity == severity && found[0].message.contains("orbitale_left"), "{found:?}");
        }
        // On a turned head left is not +x.
        for tilt in tilts() {
            let found = of(&moved(&exchange(only), |p| tilt * p), None, None);
            assert_eq!(codes(&found), ["landmarks-sides-exchanged"], "{found:?}");
        }
    }
}

#[test]
fn single_points_off_their_surface_or_out_of_order_are_named() {
    let head = phantom();
    let with = |name: &str, by: Vector| -> Vec<(String, Point)> {
        head.points.iter().map(|(n, p)| (n.clone(), if n == name { p + by } else { *p })).collect()
    };
    let found = of(&with("pronasale", Vector::new(0.0, -15.0, 0.0)), Some(&head.skin), Some(&head.skull));
    assert_eq!(codes(&found), ["landmarks-off-surface"], "{found:?}");
    assert!(
        found[0].severity == Severity::Check && found[0].message.contains("pronasale 15 mm from the skin"),
        "{found:?}"
    );
    let mut swapped = head.points.clone();
    for (name, _) in &mut swapped {
        *name = match name.as_str() {
            "ans" => "pogonion".to_owned(),
            "pogonion" => "ans".to_owned(),
            other => other.to_owned(),
        };
    }
    let found = of(&swapped, Some(&head.skin), Some(&head.skull));
    assert!(codes(&found).contains(&"landmarks-out-of-order") && found.len() == 1, "{found:?}");
    assert!(found[0].message.contains("pogonion lies") && found[0].message.contains("above ans"), "{found:?}");
}

#[test]
fn a_head_in_any_pose_gives_no_finding() {
    let head = phantom();
    let proposal = propose(&head.skin, &head.skull);
    let proposed: Vec<(String, Point)> = proposal.points.into_iter().collect();
    assert!(proposed.len() > 15);
    for points in [&head.points, &proposed] {
        for motion in std::iter::once(Motion::identity()).chain(tilts()) {
            let there = moved(points, |p| motion * p);
            let (skin, skull) = (head.skin.moved(&motion), head.skull.moved(&motion));
            for (skin, skull) in [(Some(&skin), Some(&skull)), (Some(&skin), None), (None, Some(&skull)), (None, None)]
            {
                let found = of(&there, skin, skull);
                assert!(found.is_empty(), "{motion:?}: {found:#?}");
            }
        }
    }
}

#[test]
fn unconfirmed_points_are_not_judged() {
    let head = phantom();
    let points = moved(&head.points, |p| p + Vector::z() * 40.0);
    let unconfirmed: Vec<String> = points.iter().map(|(name, _)| name.clone()).collect();
    let landmarks = GivenLandmarks { points: &points, unconfirmed: &unconfirmed, midline_x_mm: None };
    assert!(check_landmarks(&landmarks, Some(&head.skin), Some(&head.skull)).unwrap().is_empty());
}

#[test]
fn a_midline_beside_the_landmarks_is_reported() {
    let head = phantom();
    let at = |midline_x_mm| {
        let landmarks = GivenLandmarks { points: &head.points, unconfirmed: &[], midline_x_mm: Some(midline_x_mm) };
        codes(&check_landmarks(&landmarks, None, None).unwrap())
    };
    assert!(at(14.0).is_empty() && at(8.0).is_empty());
    assert_eq!(at(-14.0), ["landmarks-out-of-order"]);
}

#[test]
fn skin_and_bone_in_two_frames_are_reported_with_the_change_that_fits() {
    let head = phantom();
    type Case = (&'static str, fn(&Point) -> Point, &'static str);
    let cases: [Case; 5] = [
        ("RAS", ras, "RAS and LPS"),
        ("mirrored", mirrored, "mirrored in x"),
        ("cm", |p| p * 0.1, "by 10"),
        ("inches", |p| p / 25.4, "by 25.4"),
        ("m", |p| p * 0.001, "by 1000"),
    ];
    for (name, change, text) in cases {
        for (skin, skull) in
            [(changed(&head.skin, change), head.skull.clone()), (head.skin.clone(), changed(&head.skull, change))]
        {
            let found = check_skin_and_bone(&skin, &skull, ["skin", "skull"]).unwrap();
            let found = found.unwrap_or_else(|| panic!("{name}: nothing was found"));
            assert!(found.code == "surfaces-wrong-frame" && found.message.contains(text), "{name}: {found:?}");
        }
    }
    let aside = head.skull.moved(&Motion::translation(60.0, 30.0, 40.0));
    let found = check_skin_and_bone(&head.skin, &aside, ["skin", "skull"]).unwrap().unwrap();
    assert!(found.code == "surfaces-cross" && found.message.contains("do not belong together"), "{found:?}");
}

#[test]
fn skin_and_bone_of_one_head_in_any_pose_open_or_cut_give_no_finding() {
    let head = phantom();
    let none = |skin: &TriMesh, skull: &TriMesh| {
        let found = check_skin_and_bone(skin, skull, ["skin", "skull"]).unwrap();
        assert!(found.is_none(), "{found:?}");
    };
    for motion in std::iter::once(Motion::identity()).chain(tilts()) {
        none(&head.skin.moved(&motion), &head.skull.moved(&motion));
    }
    let part = |mesh: &TriMesh, keep: &dyn Fn(&Point) -> bool| {
        let kept: Vec<u32> =
            (0..mesh.triangles().len() as u32).filter(|t| mesh.corners(*t as usize).iter().all(keep)).collect();
        prosopon_geometry::submesh(mesh, &kept).unwrap()
    };
    // A scan of the face alone, an open neck, only the jaws, and a skin inside out.
    none(&part(&head.skin, &|p| p.y < -40.0), &head.skull);
    none(&part(&head.skin, &|p| p.z > 0.0), &head.skull);
    none(&head.skin, &part(&head.skull, &|p| p.z < 50.0));
    let inside_out = head.skin.triangles().iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    none(&TriMesh::new(head.skin.positions().to_vec(), inside_out).unwrap(), &head.skull);
    let mixed = head.skin.triangles().iter().enumerate();
    let mixed = mixed.map(|(i, [a, b, c])| if i % 3 == 0 { [*a, *c, *b] } else { [*a, *b, *c] }).collect();
    none(&TriMesh::new(head.skin.positions().to_vec(), mixed).unwrap(), &head.skull);
}

#[test]
fn a_target_that_is_not_registered_is_reported_only_in_another_frame() {
    let head = phantom();
    // Another pose of the scanner, and a chin moved by 6 mm.
    let after = changed(&head.skin, |p| if p.z < 0.0 { p + Vector::y() * -6.0 } else { *p });
    let pose = Motion::translation(5.0, 40.0, -120.0) * Motion::rotation(Vector::new(0.1, -0.1, 0.12));
    let target = after.moved(&pose);
    let of = |target: &TriMesh| check_two_skins(&head.skin, target, ["skin", "target"]).unwrap();
    for same in [&head.skin, &after, &target] {
        assert_eq!(of(same), None);
    }
    // A tiny skin lies close to a piece of any other.
    let found = of(&changed(&after, |p| p * 0.1)).unwrap();
    assert!(found.code == "surfaces-wrong-frame" && found.message.contains("cm instead of mm"), "{found:?}");
    // A face that is not symmetric, mirrored.
    let crooked = |p: &Point| p + Vector::x() * (0.1 * (p.z - 20.0)) + Vector::y() * (0.15 * p.x);
    let (one, other) = (changed(&head.skin, crooked), changed(&changed(&after, crooked), mirrored));
    let found = check_two_skins(&one, &other, ["skin", "target"]).unwrap();
    assert!(found.as_ref().is_some_and(|w| w.message.contains("mirrored")), "{found:?}");
    // Turned by 180°, a tilted phantom is too much like itself, front to back, to be told from another pose.
    let found = of(&changed(&after, ras)).unwrap();
    assert!(found.code == "surfaces-wrong-frame" && found.message.contains("RAS and LPS"), "{found:?}");
}

#[test]
fn every_landmark_of_the_program_is_known() {
    let head = head();
    for (name, _) in &head.landmarks.points {
        assert!(known(name).is_some(), "{name}");
    }
    assert_eq!(known("condylion_left").map(|k| k.limit_mm), Some(14.0));
    assert_eq!(known("soft_anything").map(|k| k.tissue), Some(Tissue::Skin));
    assert!(known("pogonion_left").is_none() && known("marker_7").is_none());
}
