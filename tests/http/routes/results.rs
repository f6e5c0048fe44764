use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::binary::Server;
use crate::support::shapes::{cube, stl};
use crate::support::tissue_mesh::slab;

/// Solves a plan; returns session, plan and job.
pub(super) async fn solved(app: &TestApp, more: Value) -> (String, String, String) {
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, more).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    (session, plan, job)
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

#[tokio::test]
async fn frames_and_topology_have_the_documented_layout() {
    let app = TestApp::new().await;
    let (session, _, job) = solved(&app, json!({"steps": 2})).await;
    let topology = app.get(&format!("{job}/topology")).await;
    assert_eq!(topology.body.len(), 12 * 12);
    let frame = app.get(&format!("{job}/steps/1/frame")).await;
    assert_eq!(frame.header("prosopon-scalars"), "displacement_mm");
    let values = floats(&frame.body);
    assert_eq!(values.len(), 4 * 8);
    let moved = (9.0f32 + 0.75 * 0.75).sqrt();
    assert!(values[24..].iter().all(|d| (d - moved).abs() < 1e-6));
    let lowest_y = values[..24].as_chunks::<3>().0.iter().map(|p| p[1]).fold(f32::MAX, f32::min);
    assert_eq!(lowest_y, -103.0);
    let rest = app.get(&format!("{job}/steps/0/frame")).await;
    assert_eq!(rest.header("prosopon-scalars"), "displacement_mm");
    let at_rest = floats(&rest.body);
    assert!(at_rest.len() == 4 * 8 && at_rest[24..].iter().all(|d| *d == 0.0));
    assert_eq!(at_rest[..24].as_chunks::<3>().0.iter().map(|p| p[1]).fold(f32::MAX, f32::min), -100.0);
    let stl_at_rest = app.get(&format!("{job}/steps/0/skin?format=stl")).await;
    assert_eq!(stl_at_rest.body.len(), 84 + 50 * 12);
    app.get(&format!("{job}/steps/0/skin?register=true")).await.problem(404, "not-found");
    app.get(&format!("{job}/steps/3/skin")).await.problem(404, "not-found");
    // The current skin of the session no longer matters.
    app.upload(&format!("{session}/skin"), stl(&cube([0.0; 3], 50.0))).await.ok();
    assert_eq!(app.get(&format!("{job}/steps/1/frame")).await.body, frame.body);
    assert_eq!(app.get(&format!("{job}/topology")).await.body, topology.body);
    assert_eq!(app.get(&format!("{job}/steps/0/frame")).await.body, rest.body);
    assert_eq!(app.get(&format!("{job}/steps/0/skin?format=stl")).await.body, stl_at_rest.body);
    for (format, magic) in [("glb", "glTF"), ("ply", "ply\n"), ("stl", "")] {
        let skin = app.get(&format!("{job}/steps/1/skin?format={format}")).await;
        assert!(skin.status.is_success() && skin.body.starts_with(magic.as_bytes()), "{format}");
    }
    let ply = app.get(&format!("{job}/steps/1/skin?format=ply")).await.body;
    assert!(String::from_utf8_lossy(&ply[..400]).contains("displacement_mm"));
}

#[tokio::test]
async fn results_support_etags_ranges_and_compression() {
    let app = TestApp::new().await;
    let (_, _, job) = solved(&app, json!({})).await;
    let path = format!("{job}/steps/6/frame");
    let whole = app.get(&path).await;
    let tag = whole.header("etag").to_owned();
    assert_eq!(tag.trim_matches('"'), prosopon_store::sha256_hex(&whole.body));
    let known = app.call(Method::GET, &path, &[("if-none-match", &tag)], Body::empty()).await;
    assert_eq!((known.status, known.body.len()), (StatusCode::NOT_MODIFIED, 0));
    let part = app.call(Method::GET, &path, &[("range", "bytes=4-11")], Body::empty()).await;
    assert_eq!((part.status, part.header("content-range")), (StatusCode::PARTIAL_CONTENT, "bytes 4-11/128"));
    assert_eq!(part.body, whole.body.slice(4..12));
    let beyond = app.call(Method::GET, &path, &[("range", "bytes=999-")], Body::empty()).await;
    assert_eq!(beyond.problem(416, "range-not-satisfiable")["bytes"], 128);

    let report = format!("{job}/report");
    let packed = app.call(Method::GET, &report, &[("accept-encoding", "gzip")], Body::empty()).await;
    assert_eq!(packed.header("content-encoding"), "gzip");
    let plain = app.get(&report).await;
    assert!(packed.body.len() < plain.body.len());
    assert_ne!(packed.header("etag"), plain.header("etag"), "a strong tag names bytes");
    for tag in [packed.header("etag"), plain.header("etag")] {
        for encoding in ["gzip", "identity"] {
            let headers = [("if-none-match", tag), ("accept-encoding", encoding)];
            let known = app.call(Method::GET, &report, &headers, Body::empty()).await;
            assert_eq!((known.status, known.header("etag")), (StatusCode::NOT_MODIFIED, tag));
        }
    }
}

#[tokio::test]
async fn without_a_reference_there_is_no_error() {
    let app = TestApp::new().await;
    let (_, _, job) = solved(&app, json!({})).await;
    app.get(&format!("{job}/steps/6/error")).await.problem(404, "no-reference");
    app.get(&format!("{job}/steps/6/error.png")).await.problem(404, "no-reference");
    assert_eq!(app.get(&format!("{job}/report")).await.ok()["error"], json!(null));
}

#[tokio::test]
async fn errors_are_measured_against_the_target() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.upload(&format!("{session}/target"), stl(&cube([0.0, -10.0, 0.0], 100.0))).await.ok();
    let job = app.solve(&session, &plan, json!({"steps": 3})).await;
    app.ended(&job).await.ok();
    let error = app.get(&format!("{job}/steps/3/error")).await.ok();
    assert_eq!((&error["reference"], &error["whole"]["mean_mm"]), (&json!("target"), &json!(-4.0)));
    assert_eq!(error["regions"]["upper_lip"]["share_below_3_mm"], 1.0);
    assert_eq!(error["values_mm"], json!(vec![-4.0; 8]));
    let frame = app.get(&format!("{job}/steps/3/frame")).await;
    assert_eq!(frame.header("prosopon-scalars"), "displacement_mm,error_mm");
    assert_eq!(floats(&frame.body)[32..], [-4.0; 8]);
    assert_eq!(app.get(&format!("{job}/report")).await.ok()["error"]["whole"]["rms_mm"], 4.0);
    let events = String::from_utf8(app.get(&format!("{job}/events")).await.body.to_vec()).unwrap();
    assert!(events.contains(&format!("{job}/steps/3/error")));
}

#[tokio::test]
async fn errors_are_measured_against_the_same_path_parameter_of_a_reference_job() {
    let app = TestApp::new().await;
    let (session, plan, fine) = solved(&app, json!({"steps": 4})).await;
    let id = fine.rsplit('/').next().unwrap();
    let job = app.solve(&session, &plan, json!({"steps": 6, "reference_job": id})).await;
    app.ended(&job).await.ok();
    // Both jobs have steps only at one half and at the end.
    for k in [1, 2, 4, 5] {
        app.get(&format!("{job}/steps/{k}/error")).await.problem(404, "no-reference");
    }
    let half = app.get(&format!("{job}/steps/3/error")).await.ok();
    assert_eq!((&half["reference"], &half["whole"]["max_mm"]), (&json!(format!("job {id} step 2")), &json!(0.0)));
    assert_eq!(half["models"], json!(["nonlinear", "nonlinear"]), "a difference, no error");
    let on_demand = app.get(&format!("{job}/steps/3/error?reference={id}")).await.ok();
    assert_eq!(on_demand["models"], half["models"]);
    assert_eq!(app.get(&format!("{job}/report")).await.ok()["error"]["reference"], format!("job {id} step 4"));
}

/// The first frame can be read while later steps are still being solved.
#[test]
fn the_first_frame_arrives_before_the_last_step_is_solved() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    server.upload(&format!("{session}/tissue"), &slab(1.0)).ok();
    let paths = json!([{"segment": 1, "waypoints": [{"t": 1, "translation_mm": [0.5, 0, 2]}]}]);
    let plan = server.post(&format!("{session}/plans"), &json!({"paths": paths})).ok()["id"].clone();
    let job = server.post(&format!("{session}/jobs"), &json!({"plan": plan, "model": "nonlinear", "steps": 40})).ok();
    let own = job["links"]["self"].as_str().unwrap();
    let mut stream = server.stream(&format!("{own}/events"));
    loop {
        let event = stream.next_event();
        if event["event"] == "step" {
            assert_eq!(event["data"]["k"], 1);
            let frame = server.get(event["data"]["links"]["frame"].as_str().unwrap());
            assert_eq!(frame.status, 200);
            let view = server.get(own).ok();
            assert!(view["status"] == "running" && view["step"].as_u64().unwrap() < 40, "{view}");
            break;
        }
        assert_ne!(event["event"], "end", "no step came before the end");
    }
    server.post(&format!("{own}/cancel"), &json!({})).ok();
}

#[tokio::test]
async fn a_path_is_one_animated_file_and_frames_come_in_short() {
    let app = TestApp::new().await;
    let (_, _, job) = solved(&app, json!({"steps": 2})).await;
    let path = app.get(&format!("{job}/path.glb")).await;
    assert_eq!((path.status, path.header("content-type")), (StatusCode::OK, "model/gltf-binary"));
    let length = u32::from_le_bytes(path.body[12..16].try_into().unwrap()) as usize;
    let root: Value = serde_json::from_slice(&path.body[20..20 + length]).unwrap();
    assert_eq!(root["meshes"][0]["extras"]["targetNames"], json!(["step 1 (t = 0.5)", "step 2 (t = 1)"]));
    assert_eq!(root["scenes"][0]["extras"]["path_parameters"], json!([0.5, 1.0]));
    assert_eq!(root["scenes"][0]["extras"]["colour"]["shows"], "displacement_mm");
    let plain = app.get(&format!("{job}/path.glb?colour=none")).await;
    assert!(plain.body.len() < path.body.len() && plain.header("etag") != path.header("etag"));
    app.get(&format!("{job}/path.glb?colour=error")).await.problem(404, "no-reference");

    let (rest, frame) = (format!("{job}/steps/0/frame"), format!("{job}/steps/2/frame"));
    let (rest, exact) = (floats(&app.get(&rest).await.body), floats(&app.get(&frame).await.body));
    let short = app.get(&format!("{frame}?numbers=int16")).await;
    let step = f32::from_le_bytes(short.body[..4].try_into().unwrap());
    let moved = short.body[4..].as_chunks::<2>().0.iter().map(|b| f32::from(i16::from_le_bytes(*b)) * step);
    assert_eq!(short.body.len(), 4 + 2 * 3 * (exact.len() / 4));
    // Half a step, and the rounding of positions of some 100 mm.
    assert!(moved.zip(rest.iter().zip(&exact)).all(|(d, (from, to))| (from + d - to).abs() < 0.5 * step + 1e-4));
}
