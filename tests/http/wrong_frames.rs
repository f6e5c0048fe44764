//! Landmarks and surfaces of one head in two frames, with the real numerics on a coarse phantom.

use prosopon_formats::export;
use prosopon_geometry::{Point, TriMesh};
use prosopon_planning::phantom;
use serde_json::{Map, Value, json};

use crate::support::binary::Server;

fn surface(part: &str) -> TriMesh {
    let head = phantom::head();
    let solid = if part == "skin" { &head.skin } else { &head.skull };
    phantom::surface_of(solid.as_ref(), &head.bounds(), 3.0).unwrap()
}

fn ras(p: &Point) -> Point {
    Point::new(-p.x, -p.y, p.z)
}

fn landmarks(change: impl Fn(&Point) -> Point) -> Value {
    let point = |(name, p): &(String, Point)| {
        let p = change(p);
        (name.clone(), json!([p.x, p.y, p.z]))
    };
    json!({
        "points": phantom::head().landmarks.points.iter().map(point).collect::<Map<_, _>>(),
        "midline_x_mm": 0, "occlusal_plane_z_mm": 0,
        "le_fort_1_plane": {"point_mm": [0, -60, 32], "normal": [0, 0, 1]}
    })
}

fn codes(answer: &Value) -> Vec<&str> {
    let all = answer["warnings"].as_array().map(Vec::as_slice).unwrap_or_default();
    all.iter().map(|w| w["code"].as_str().unwrap()).collect()
}

#[test]
fn landmarks_in_ras_are_reported_at_the_put_and_by_every_job() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let path = format!("{session}/landmarks");
    let right = server.put_json(&path, &landmarks(|p| *p)).ok();
    assert_eq!(right.get("warnings"), None, "{right}");

    let wrong = server.put_json(&path, &landmarks(ras)).ok();
    assert_eq!(codes(&wrong), ["landmarks-wrong-frame"], "{wrong}");
    let message = wrong["warnings"][0]["message"].as_str().unwrap();
    assert!(message.contains("pronasale ") && message.contains("RAS"), "{message}");
    // The answer can be sent back, and its warnings are not stored.
    assert_eq!(server.put_json(&path, &wrong).ok(), wrong);
    assert_eq!(server.get(&path).ok().get("warnings"), None);

    let cut = json!({ "template": { "name": "le_fort_1" } });
    let osteotomy = server.post(&format!("{session}/osteotomies"), &cut).ok();
    assert!(codes(&osteotomy).contains(&"landmarks-wrong-frame"), "{osteotomy}");
    let segments = osteotomy["segments"].as_array().unwrap();
    let is_jaw = |s: &&Value| s["id"] != 0 && s["bounded_by"].as_array().unwrap().contains(&json!(0));
    let jaw = segments.iter().find(is_jaw).unwrap()["id"].clone();

    let mesh = json!({ "osteotomy": osteotomy["id"], "edge_mm": 8.0 });
    let mesh = server.finish(&server.post(&format!("{session}/mesh"), &mesh));
    assert!(codes(&mesh).contains(&"landmarks-wrong-frame"), "{mesh}");

    let waypoints = json!([{ "t": 1, "translation_mm": [0, -4, 0] }]);
    let plan = json!({ "osteotomy": osteotomy["id"], "paths": [{ "segment": jaw, "waypoints": waypoints }] });
    let plan = server.post(&format!("{session}/plans"), &plan).ok()["id"].clone();
    let solve = json!({ "plan": plan, "model": "mixed", "steps": 2 });
    let job = server.finish(&server.post(&format!("{session}/jobs"), &solve));
    let report = server.get(&format!("/v1/jobs/{}/report", job["id"].as_str().unwrap())).ok();
    let found = codes(&report);
    for code in ["landmarks-wrong-frame", "points-not-measured", "regions-by-proportions"] {
        assert!(found.contains(&code), "{code}: {}", report["warnings"]);
    }
    // No number for a point that is not on the face, and regions that hold skin.
    let soft = report["clinical"]["soft_points"].as_array().unwrap();
    assert!(!soft.iter().any(|p| p["name"] == "pronasale"), "{soft:?}");
    assert!(report["regions"].as_object().unwrap().contains_key("upper_lip"), "{}", report["regions"]);
}

#[test]
fn a_skin_in_ras_is_reported_when_the_skull_comes() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    // Beside the scanner's middle, as real heads lie: about it, the phantom's skull would fit the turned skin.
    let aside = |p: &Point| Point::new(p.x, p.y + 40.0, p.z);
    let placed = |part: &str| {
        let mesh = surface(part);
        mesh.with_positions(mesh.positions().iter().map(aside).collect()).unwrap()
    };
    let (skin, skull) = (placed("skin"), placed("skull"));
    let turned = skin.with_positions(skin.positions().iter().map(ras).collect()).unwrap();
    let put = |part: &str, mesh: &TriMesh| server.upload(&format!("{session}/{part}"), &export::stl(mesh)).ok();
    assert!(codes(&put("skin", &turned)).is_empty());
    let second = put("skull", &skull);
    assert_eq!(codes(&second), ["surfaces-wrong-frame"], "{second}");
    // Left and right of the phantom are alike, so that its mirror image fits as well as the turn.
    assert!(second["warnings"][0]["message"].as_str().unwrap().contains("0 % would lie outside"), "{second}");
    // The landmarks come before the skin that fits: the answer about the skin has what is wrong with them.
    let points = landmarks(|p| Point::new(p.x - 900.0, p.y + 40.0, p.z));
    server.put_json(&format!("{session}/landmarks"), &points).ok();
    let third = put("skin", &skin);
    assert!(codes(&third).iter().any(|code| code.starts_with("landmarks-")), "{third}");
    assert!(codes(&put("target", &skin)).is_empty());
}
