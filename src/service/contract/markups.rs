//! Landmark files of 3D Slicer: `.mrk.json` and `.fcsv`.

use serde_json::Value;

use super::check::Check;
use super::fault::{Fault, FaultKind};
use super::fault_from::import_fault;
use super::landmarks::LandmarksDocument;
use super::markups_names::{Named, from_ras, listed};
use prosopon_formats::import::{LandmarkFile, LandmarkFrame, fiducials, looks_like_fiducials};
use prosopon_geometry::Warning;

/// Units of `coordinateUnits` (UCUM) in mm.
const UNITS_MM: [(&str, f64); 8] = [
    ("mm", 1.0),
    ("cm", 10.0),
    ("dm", 100.0),
    ("m", 1000.0),
    ("um", 1e-3),
    ("[in_i]", 25.4),
    ("in", 25.4),
    ("inch", 25.4),
];
/// Markups whose control points are landmarks; those of curves, planes and boxes only shape them.
const POINT_TYPES: [&str; 4] = ["Fiducial", "Line", "Angle", ""];

/// What the two formats have in common, and findings on the way.
#[derive(Debug, Default)]
struct Read {
    file: LandmarkFile,
    findings: Vec<Warning>,
}

/// The landmarks of a file that 3D Slicer wrote, LPS mm, with the service's names and notes of what was converted.
///
/// `None` when the bytes are no such file, for example landmarks in the service's own form.
///
/// # Errors
/// A fault that lists what cannot be read, and labels that name the same landmark.
pub fn landmarks_of_file(bytes: &[u8]) -> Option<Result<LandmarksDocument, Fault>> {
    let read = if looks_like_fiducials(bytes) {
        fiducials(bytes)
            .map(|file| Read { file, findings: Vec::new() })
            .map_err(|error| import_fault(&error, FaultKind::InvalidRequest))
    } else {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        let value: Value = text.starts_with(b"{").then(|| serde_json::from_slice(text).ok()).flatten()?;
        // The own form has no member of this name.
        markups(value.get("markups")?)
    };
    Some(read.and_then(document))
}

fn document(read: Read) -> Result<LandmarksDocument, Fault> {
    let Read { file, mut findings } = read;
    if file.points.is_empty() {
        let detail = match file.unplaced.len() {
            0 => "the file has no points".to_owned(),
            n => format!("none of the {n} points of the file has been placed"),
        };
        return Err(Fault::new(
            FaultKind::InvalidRequest,
            format!("{detail}; place the landmarks and save them again"),
        ));
    }
    let named = Named::of(&file)?;
    findings.extend(frame_findings(&file));
    findings.extend(named.findings());
    let mut document = LandmarksDocument { points: named.points, ..LandmarksDocument::default() };
    document.note(findings.into_iter().collect());
    Ok(document)
}

fn frame_findings(file: &LandmarkFile) -> Vec<Warning> {
    let mut found = Vec::new();
    if let Some(frame) = file.assumed {
        let message = format!("the file states no coordinate system; {} was assumed, as in 3D Slicer", frame.name());
        found.push(
            Warning::check("no-coordinate-system", message).act("Check that left is left and the front in front."),
        );
    }
    if file.from_ras > 0 {
        found.push(from_ras(file.from_ras));
    }
    if !file.unplaced.is_empty() {
        let (n, labels) = (file.unplaced.len(), listed(&file.unplaced));
        let message = format!("{n} points of the file have no position and were left out: {labels}");
        found.push(Warning::info("landmarks-not-placed", message));
    }
    if file.has_decimal_commas {
        found.push(Warning::info(
            "decimal-commas",
            "numbers of the file have a decimal comma, which was read as a point",
        ));
    }
    found
}

/// Reads the member `markups` of a `.mrk.json` file.
fn markups(value: &Value) -> Result<Read, Fault> {
    let (mut check, mut read) = (Check::default(), Read::default());
    let Some(nodes) = value.as_array() else {
        check.fault("/markups", "must be a list");
        check.finish()?;
        return Ok(read);
    };
    let mut left_out = Vec::new();
    for (index, node) in nodes.iter().enumerate().take(1000) {
        let kind = node.get("type").and_then(Value::as_str).unwrap_or_default();
        if POINT_TYPES.contains(&kind) {
            self::node(&mut check, &format!("/markups/{index}"), node, &mut read);
        } else {
            left_out.push(kind.to_owned());
        }
    }
    if !left_out.is_empty() {
        let message = format!("{} markups that hold no landmarks were left out: {}", left_out.len(), listed(&left_out));
        read.findings.push(Warning::info("markups-left-out", message));
    }
    check.finish()?;
    Ok(read)
}

/// Reads one list of control points.
fn node(check: &mut Check, pointer: &str, node: &Value, read: &mut Read) {
    let frame = match node.get("coordinateSystem") {
        None => {
            read.file.assumed = Some(LandmarkFrame::Lps);
            LandmarkFrame::Lps
        }
        Some(stated) => {
            let word = stated.as_str().map_or_else(|| stated.to_string(), str::to_owned);
            LandmarkFrame::of(&word).unwrap_or_else(|| {
                let detail = "must be LPS (1) or RAS (0); save the landmarks in one of them";
                check.fault(format!("{pointer}/coordinateSystem"), detail);
                LandmarkFrame::Lps
            })
        }
    };
    let unit_mm = unit(check, pointer, node, read);
    let points = match node.get("controlPoints") {
        None => return,
        Some(points) => points.as_array(),
    };
    let Some(points) = points else {
        check.fault(format!("{pointer}/controlPoints"), "must be a list");
        return;
    };
    for (index, point) in points.iter().enumerate().take(10_000) {
        let text = |name: &str| point.get(name).and_then(Value::as_str).unwrap_or_default();
        let label = if text("label").is_empty() { text("id") } else { text("label") }.to_owned();
        if !["", "defined"].contains(&text("positionStatus")) {
            read.file.unplaced.push(label);
            continue;
        }
        let position = point.get("position").and_then(triple);
        match position {
            Some(position) => read.file.push(label, position.map(|c| c * unit_mm), frame),
            None => check.fault(format!("{pointer}/controlPoints/{index}/position"), "must be three numbers"),
        }
    }
}

fn triple(value: &Value) -> Option<[f64; 3]> {
    let [x, y, z] = value.as_array()?.as_slice() else { return None };
    Some([x.as_f64()?, y.as_f64()?, z.as_f64()?])
}

/// Length of the unit of a node's coordinates, mm.
fn unit(check: &mut Check, pointer: &str, node: &Value, read: &mut Read) -> f64 {
    let Some(stated) = node.get("coordinateUnits").filter(|unit| !unit.is_null()) else { return 1.0 };
    // A text, or a coded entry: [value, scheme, meaning].
    let word = stated.as_str().or_else(|| stated.get(0)?.as_str()).unwrap_or_default();
    if word.is_empty() && stated.is_string() {
        return 1.0;
    }
    let Some((name, mm)) = UNITS_MM.iter().find(|(name, _)| *name == word) else {
        check.fault(format!("{pointer}/coordinateUnits"), "is an unknown unit; save the landmarks in mm");
        return 1.0;
    };
    if *mm != 1.0 {
        let message = format!("coordinates of the file are in {name} and were converted to mm");
        read.findings.push(Warning::info("landmarks-unit", message));
    }
    *mm
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(value: &Value) -> Result<LandmarksDocument, Fault> {
        landmarks_of_file(value.to_string().as_bytes()).unwrap()
    }

    fn codes(document: &LandmarksDocument) -> Vec<&str> {
        document.warnings.iter().chain(&document.notes).map(|w| w.code.as_str()).collect()
    }

    /// The same three points in every form that states its frame.
    #[test]
    fn slicers_markups_become_landmarks() {
        let point =
            |label: &str, p: [f64; 3]| json!({"id": "1", "label": label, "position": p, "positionStatus": "defined"});
        let all = |s: f64, u: f64| {
            json!([
                point("ANS", [6.0 * s * u, -84.0 * s * u, 45.0 * u]),
                point("Pog'", [6.0 * s * u, -83.0 * s * u, -20.0 * u]),
                point("Go (L)", [50.0 * s * u, 0.0, -8.0 * u]),
            ])
        };
        let node = |frame: Value, points: Value| json!({"type": "Fiducial", "coordinateSystem": frame, "controlPoints": points});
        let lps = node(json!("LPS"), all(1.0, 1.0));
        let expected: Vec<(&str, [f64; 3])> = vec![
            ("ans", [6.0, -84.0, 45.0]),
            ("gonion_left", [50.0, 0.0, -8.0]),
            ("soft_pogonion", [6.0, -83.0, -20.0]),
        ];
        for (nodes, more) in [
            (json!([lps]), &[][..]),
            (json!([node(json!("RAS"), all(-1.0, 1.0))]), &["landmarks-from-ras"]),
            (json!([node(json!(0), all(-1.0, 1.0))]), &["landmarks-from-ras"]),
            (json!([node(json!("1"), all(1.0, 1.0))]), &[]),
            (json!([{"type": "Fiducial", "controlPoints": all(1.0, 1.0)}]), &["no-coordinate-system"]),
            (
                json!([{"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": ["cm", "UCUM", "centimeter"], "controlPoints": all(1.0, 0.1)}]),
                &["landmarks-unit"],
            ),
            (
                json!([lps, {"type": "Curve", "coordinateSystem": "LPS", "controlPoints": all(1.0, 1.0)}]),
                &["markups-left-out"],
            ),
            (
                json!([
                    node(
                        json!("LPS"),
                        json!([all(1.0, 1.0)[0], all(1.0, 1.0)[2], {"label": "B", "positionStatus": "undefined", "position": null}])
                    ),
                    node(json!("RAS"), json!([all(-1.0, 1.0)[1]])),
                ]),
                &["landmarks-from-ras", "landmarks-not-placed"],
            ),
        ] {
            let read = read(&json!({"@schema": "https://x/markups-schema-v1.0.3.json#", "markups": nodes})).unwrap();
            let points: Vec<(&str, [f64; 3])> = read.points.iter().map(|(n, p)| (n.as_str(), *p)).collect();
            for ((name, p), (wanted, q)) in points.iter().zip(&expected) {
                assert!(name == wanted && p.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-12), "{points:?}");
            }
            assert_eq!(points.len(), 3);
            let mut found = codes(&read);
            found.sort_unstable();
            let mut wanted = [more, &["landmarks-renamed"]].concat();
            wanted.sort_unstable();
            assert_eq!(found, wanted, "{nodes}");
        }
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let one = |more: Value| {
            let mut node = json!({"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": []});
            node.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            json!({ "markups": [node] })
        };
        let fault = |value: Value| read(&value).unwrap_err();
        for (value, pointer) in [
            (one(json!({"coordinateSystem": "IJK"})), "/markups/0/coordinateSystem"),
            (one(json!({"coordinateUnits": "furlong"})), "/markups/0/coordinateUnits"),
            (one(json!({"controlPoints": 3})), "/markups/0/controlPoints"),
            (
                one(json!({"controlPoints": [{"label": "A", "position": [1, 2]}]})),
                "/markups/0/controlPoints/0/position",
            ),
            (json!({"markups": {}}), "/markups"),
        ] {
            let fault = fault(value);
            assert_eq!(fault.errors.first().map(|e| e.pointer.as_str()), Some(pointer), "{fault:?}");
        }
        assert!(fault(one(json!({}))).detail.contains("no points"));
        let unplaced = one(json!({"controlPoints": [{"label": "A", "positionStatus": "undefined"}]}));
        assert!(fault(unplaced).detail.contains("none of the 1 points"));
        for own in ["{}", "{\"points\": {}}", "[]", "", "{\"markups\":"] {
            assert!(landmarks_of_file(own.as_bytes()).is_none(), "{own}");
        }
    }

    #[test]
    fn a_list_of_fiducials_is_read_too() {
        let text = "# Markups fiducial file version = 4.10\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n\
            a,-6,84,45,0,0,0,1,1,1,0,ANS,,\n";
        let read = landmarks_of_file(text.as_bytes()).unwrap().unwrap();
        assert_eq!(read.points["ans"], [6.0, -84.0, 45.0]);
        assert_eq!(codes(&read), ["no-coordinate-system", "landmarks-from-ras", "landmarks-renamed"]);
        let broken = landmarks_of_file(text.replace("84", "x").as_bytes()).unwrap().unwrap_err();
        assert!(broken.detail.contains("line 3"), "{broken:?}");
    }
}
