//! The phantom turned in the scanner: the same cuts and the same face, in its own frame.

use nalgebra::UnitQuaternion;
use serde_json::{Map, Value, json};

use crate::support::binary::Server;
use prosopon_formats::export;
use prosopon_formats::import::{Limits, detect_surface, surface};
use prosopon_geometry::{Motion, TriMesh, Vector};
use prosopon_planning::phantom;

/// Largest distance between the faces of two poses, mm, at the 95th percentile: the frames differ by the rounding of the files.
const SAME_FACE_MM: f64 = 0.03;

/// Largest difference of the mean movement of a part of the face, mm: with edges of 8 mm single nodes change between tied and gliding.
const SAME_REGION_MM: f64 = 0.1;

fn numbers(v: Vector) -> Value {
    json!([v.x, v.y, v.z])
}

/// What the service says of a head in one pose.
struct Answer {
    names_and_volumes: Vec<(Value, f64)>,
    forward_mm: Vec<(String, f64)>,
    skin: TriMesh,
    frame: Value,
}

/// Le Fort I, forward in the direction of the head by 4 mm, on the phantom that `pose` moved.
fn answer(server: &Server, pose: &Motion) -> Answer {
    let session = server.session();
    let head = phantom::head();
    for (part, solid) in [("skin", &head.skin), ("skull", &head.skull)] {
        let mesh = phantom::surface_of(solid.as_ref(), &head.bounds(), 3.0).unwrap().moved(pose);
        server.upload(&format!("{session}/{part}"), &export::stl(&mesh)).ok();
    }
    let (point, normal) = head.landmarks.le_fort_1_plane;
    let points = head.landmarks.points.iter().map(|(name, p)| (name.clone(), numbers((pose * p).coords)));
    let plane = json!({ "point_mm": numbers((pose * point).coords), "normal": numbers(pose * normal) });
    let landmarks = json!({ "points": points.collect::<Map<_, _>>(), "le_fort_1_plane": plane });
    server.put_json(&format!("{session}/landmarks"), &landmarks).ok();
    let coarse = json!({ "spacing_mm": 2.0, "envelope_spacing_mm": 2.0, "envelope_closing_mm": 4.0 });
    server.put_json(&format!("{session}/field/settings"), &coarse).ok();
    server.finish(&server.post(&format!("{session}/field"), &json!({})));
    let osteotomy =
        server.post(&format!("{session}/osteotomies"), &json!({ "template": { "name": "le_fort_1" } })).ok();
    let segments = osteotomy["segments"].as_array().unwrap();
    let jaw = segments.iter().find(|s| s["name"] == "maxilla").unwrap();
    server.finish(&server.post(&format!("{session}/mesh"), &json!({ "osteotomy": osteotomy["id"], "edge_mm": 8.0 })));
    let way = json!({ "t": 1, "translation_mm": numbers(pose * Vector::new(0.0, -4.0, 0.0)) });
    let plan = json!({ "osteotomy": osteotomy["id"], "paths": [{ "segment": jaw["id"], "waypoints": [way] }] });
    let job = server.finish(&server.post(&format!("{session}/jobs"), &json!({ "plan": plan, "steps": 1 })));
    let job = format!("/v1/jobs/{}", job["id"].as_str().unwrap());
    let report = server.get(&format!("{job}/report")).ok();
    let file = server.get(&format!("{job}/steps/1/skin?format=ply")).body;
    let (skin, _) = surface(&file, detect_surface(&file).unwrap(), &Limits::default()).unwrap();
    let forward = report["regions"].as_object().unwrap().iter();
    Answer {
        names_and_volumes: segments.iter().map(|s| (s["name"].clone(), s["volume_mm3"].as_f64().unwrap())).collect(),
        forward_mm: forward.map(|(name, r)| (name.clone(), r["forward_mm"].as_f64().unwrap())).collect(),
        skin: skin.moved(&pose.inverse()),
        frame: report["frame"].clone(),
    }
}

#[test]
fn a_head_gets_the_same_cuts_and_the_same_face_in_any_pose() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let upright = answer(&server, &Motion::identity());
    assert_eq!(upright.frame["basis"], "landmarks", "{}", upright.frame);
    let moved_mm = upright.forward_mm.iter().map(|(_, mm)| mm.abs()).fold(0.0, f64::max);
    assert!(moved_mm > 1.0, "{:?}", upright.forward_mm);
    // A nod, a tilt with a turn, and a head that lies prone, each elsewhere.
    for turn in [[0.35, 0.0, 0.0], [0.2, -0.5, 0.7], [0.0, 3.1, 0.1]] {
        let shift = Vector::new(25.0, -100.0, 40.0);
        let pose = Motion::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(Vector::from(turn)));
        let there = answer(&server, &pose);
        for (a, b) in upright.names_and_volumes.iter().zip(&there.names_and_volumes) {
            assert!(a.0 == b.0 && (a.1 / b.1 - 1.0).abs() < 0.01, "{turn:?}: {a:?} {b:?}");
        }
        for (a, b) in upright.forward_mm.iter().zip(&there.forward_mm) {
            assert!(a.0 == b.0 && (a.1 - b.1).abs() < SAME_REGION_MM, "{turn:?}: {a:?} {b:?}");
        }
        let pairs = upright.skin.positions().iter().zip(there.skin.positions());
        let mut off: Vec<f64> = pairs.map(|(a, b)| (a - b).norm()).collect();
        off.sort_by(f64::total_cmp);
        let p95 = off[off.len() * 95 / 100];
        println!("turned by {turn:?}: P95 {p95:.4} mm, largest {:.4} mm", off[off.len() - 1]);
        assert!(p95 < SAME_FACE_MM, "{turn:?}: {p95} mm");
    }
}

#[test]
fn a_frame_is_estimated_set_and_estimated_again() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let empty = server.session();
    server.get(&format!("{empty}/frame")).refused(404, "not-found", "skin");
    let session = server.session_with_field();
    let path = format!("{session}/frame");
    let found = server.get(&path).ok();
    assert_eq!((&found["basis"], &found["landmarks"].as_u64().map(|n| n > 15)), (&json!("landmarks"), &Some(true)));
    assert!(found["confidence"].as_f64().unwrap() > 0.5 && found.get("warnings").is_none_or(|w| w == &json!([])));
    let axes = json!({ "left": [1, 0, 0], "back": [0, 1, 0], "up": [0, 0, 1], "origin_mm": [0, -80, 0] });
    server.put_json(&path, &axes).ok();
    let given = server.get(&path).ok();
    assert_eq!(
        (&given["basis"], &given["up"], &given["confidence"]),
        (&json!("given"), &json!([0.0, 0.0, 1.0]), &json!(1.0))
    );
    assert_eq!(server.get(&format!("{session}/field")).ok()["state"], "stale");
    let mirrored = json!({ "left": [-1, 0, 0], "back": [0, 1, 0], "up": [0, 0, 1], "origin_mm": [0, 0, 0] });
    server.put_json(&path, &mirrored).refused(422, "invalid-request", "right angles");
    assert_eq!(server.get(&path).ok(), given);
    for _ in 0..2 {
        server.delete(&path);
        assert_eq!(server.get(&path).ok(), found);
    }
    assert_eq!(server.get(&format!("{session}/field")).ok()["state"], "ready");
}
