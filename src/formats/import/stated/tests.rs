use super::*;

fn stated(line: &str) -> Stated {
    let mut stated = Stated::default();
    stated.read(line.as_bytes());
    stated
}

fn frame_of(line: &str) -> String {
    let Statements { first, other, unknown } = stated(line).frames;
    let name = first.map_or(String::new(), Frame::name);
    name + if other.is_some() { " and another" } else { "" } + if unknown { "?" } else { "" }
}

fn unit_of(line: &str) -> String {
    let Statements { first, unknown, .. } = stated(line).units;
    first.map_or("", |u| u.name).to_owned() + if unknown { "?" } else { "" }
}

#[test]
fn coordinate_systems_are_found_however_they_are_written() {
    for (line, expected) in [
        ("3D Slicer output. SPACE=RAS", "RAS"),
        ("3D Slicer output. SPACE=LPS", "LPS"),
        ("binary SPACE=RAS\0\0\0", "RAS"),
        ("COLOR=abcd SPACE=LPI,MATERIAL=x", "LPI"),
        ("space: ras", "RAS"),
        ("SPACE = left-posterior-superior", "LPS"),
        ("space: Right_Anterior_Superior", "RAS"),
        ("coordinate system: RAS", "RAS"),
        ("Coordinate_System=\"ras\"", "RAS"),
        ("CoordinateSystem: RAS+", "RAS"),
        ("exported in the coordinate system LAS", "LAS"),
        ("vertices in RAS coordinates, mm", "RAS"),
        ("SPACE=RAS; SPACE=LPS", "RAS and another"),
        ("SPACE=RAS; coordinate system: RAS", "RAS"),
        ("SPACE=scanner-xyz", "?"),
        ("coordinate system: right-handed, y up", "?"),
        // Not a statement about the patient's axes.
        ("color space: sRGB", ""),
        ("color space sap", ""),
        ("solid of Dr. Ras, Space 3", ""),
        ("frame: 12", ""),
        ("LIP frame of an SLA coordinates, AIR space", ""),
        ("frame: air", ""),
        ("frame: RAS", "RAS"),
        ("SPACE=RRS", "?"),
        ("ras", ""),
        ("Prosopon, LPS, mm", ""),
    ] {
        assert_eq!(frame_of(line), expected, "{line}");
    }
}

#[test]
fn units_are_found_however_they_are_written() {
    for (line, expected) in [
        ("UNIT=mm", "millimetres"),
        ("units: m", "metres"),
        ("units m", "metres"),
        ("File units = inches", "inches"),
        ("units in cm", "centimetres"),
        ("unit: in", "inches"),
        ("units are metres; x right", "metres"),
        ("This file uses centimeters as units for non-parametric coordinates.", "centimetres"),
        ("comment units millimetres", "millimetres"),
        ("SPACE=RAS UNIT=m", "metres"),
        ("units=parsec", "?"),
        // Not a statement about lengths.
        ("unit in the lab", ""),
        ("units: 3", ""),
        ("12 units", ""),
    ] {
        assert_eq!(unit_of(line), expected, "{line}");
    }
}

#[test]
fn axes_go_to_lps_and_mirror_images_keep_the_outside_outside() {
    let p = Point::new(1.0, 2.0, 3.0);
    for (name, expected, mirror) in [
        ("LPS", [1.0, 2.0, 3.0], false),
        ("RAS", [-1.0, -2.0, 3.0], false),
        ("LAS", [1.0, -2.0, 3.0], true),
        ("LPI", [1.0, 2.0, -3.0], true),
        ("SLP", [2.0, 3.0, 1.0], false),
        ("PLS", [2.0, 1.0, 3.0], true),
        ("ASL", [3.0, -1.0, 2.0], true),
    ] {
        let (mut points, mut triangles, mut warnings) = (vec![p], vec![[0, 1, 2]], Vec::new());
        stated(&format!("SPACE={name}")).apply(&mut points, &mut triangles, &mut warnings);
        assert_eq!(points, [Point::from(expected)], "{name}");
        assert_eq!(triangles, [if mirror { [0, 2, 1] } else { [0, 1, 2] }], "{name}");
        let codes: Vec<&str> = warnings.iter().map(|w| w.code).collect();
        assert_eq!(codes, if name == "LPS" { vec![] } else { vec!["stated-frame"] });
        assert!(warnings.iter().all(|w| w.message.contains(name)), "{warnings:?}");
    }
}

#[test]
fn what_is_unclear_is_used_with_a_warning() {
    for (line, code, x) in [
        ("SPACE=RAS SPACE=LPS", "unclear-frame", -100.0),
        ("SPACE=world", "unclear-frame", 100.0),
        ("SPACE=RAI", "unclear-frame", -100.0),
        ("units: furlongs", "unclear-unit", 100.0),
        // A head of 100 m is not meant.
        ("units: m", "unclear-unit", 100.0),
        ("units: mm, units: m", "unclear-unit", 100.0),
    ] {
        let (mut points, mut warnings) = (vec![Point::origin(), Point::new(100.0, 0.0, 0.0)], Vec::new());
        stated(line).apply(&mut points, &mut [], &mut warnings);
        assert_eq!(points[1].x, x, "{line}");
        assert_eq!(warnings[0].code, code, "{line}");
        assert!(!warnings[0].action.is_empty());
    }
    let (mut points, mut warnings) = (vec![Point::origin(), Point::new(0.2, 0.0, 0.0)], Vec::new());
    stated("units: m").apply(&mut points, &mut [], &mut warnings);
    assert_eq!((points[1].x, warnings[0].code), (200.0, "stated-unit"));
}
