use axum::body::Body;
use axum::http::{Method, StatusCode};
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, stl};

async fn solved(app: &TestApp, more: serde_json::Value) -> (String, String, String) {
    let (session, plan) = app.session_with_plan().await;
    let job = app.solve(&session, &plan, more).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    (session, plan, job)
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
}

#[tokio::test]
async fn a_frame_and_its_topology_are_laid_out_as_described() {
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
    // The current skin of the session no longer matters.
    app.upload(&format!("{session}/skin"), stl(&cube([0.0; 3], 50.0))).await.ok();
    assert_eq!(app.get(&format!("{job}/steps/1/frame")).await.body, frame.body);
    assert_eq!(app.get(&format!("{job}/topology")).await.body, topology.body);
    for (format, magic) in [("glb", "glTF"), ("ply", "ply\n"), ("stl", "")] {
        let skin = app.get(&format!("{job}/steps/1/skin?format={format}")).await;
        assert!(skin.status.is_success() && skin.body.starts_with(magic.as_bytes()), "{format}");
    }
    let ply = app.get(&format!("{job}/steps/1/skin?format=ply")).await.body;
    assert!(String::from_utf8_lossy(&ply[..400]).contains("displacement_mm"));
}

#[tokio::test]
async fn results_are_sent_once_in_part_and_compressed() {
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
async fn errors_are_against_the_target() {
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
async fn errors_are_against_the_reference_job_at_the_same_place_of_the_path() {
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
    assert_eq!(half["models"], json!(["mixed", "mixed"]), "a difference, no error");
    let on_demand = app.get(&format!("{job}/steps/3/error?reference={id}")).await.ok();
    assert_eq!(on_demand["models"], half["models"]);
    assert_eq!(app.get(&format!("{job}/report")).await.ok()["error"]["reference"], format!("job {id} step 4"));
}

#[tokio::test]
async fn any_two_stored_surfaces_can_be_compared() {
    let app = TestApp::new().await;
    let (session, _, job) = solved(&app, json!({"steps": 2})).await;
    let session = session.rsplit('/').next().unwrap();
    let job = job.rsplit('/').next().unwrap();
    let prediction = json!({"job": job, "step": 2});
    let reference = json!({"session": session, "part": "skin"});
    let body = json!({"prediction": prediction, "reference": reference, "values": true});
    let answer = app.post("/v1/compare", body).await.ok();
    assert_eq!((&answer["whole"]["mean_mm"], &answer["mask"]), (&json!(6.0), &json!("all")));
    assert_eq!(answer["values_mm"], json!(vec![6.0; 8]));
    let registered = json!({"prediction": prediction, "reference": reference, "register": {}});
    let answer = app.post("/v1/compare", registered).await.ok();
    assert_eq!(answer["whole"]["mean_mm"], 0.0);
    assert_eq!(answer["registration"]["translation_mm"], json!([0.0, 6.0, 1.5]));
    assert!(answer.get("values_mm").is_none());
    let problem = app.post("/v1/compare", json!({"prediction": {"job": job}, "reference": reference})).await;
    assert_eq!(problem.problem(422, "invalid-request")["errors"][0]["pointer"], "/prediction");
    let missing = json!({"prediction": {"session": session, "part": "target"}, "reference": reference});
    app.post("/v1/compare", missing).await.problem(404, "not-found");
}

#[tokio::test]
async fn a_field_can_be_asked() {
    let app = TestApp::new().await;
    let session = app.session_with_field().await;
    let field = app.get(&format!("{session}/field")).await.ok();
    assert_eq!((&field["state"], &field["report"]["skin"]["max_error_mm"]), (&json!("ready"), &json!(0.05)));
    assert_eq!(field["settings"]["method"], "adaptive");
    let place = json!({"elements": 10, "area_mm2": 4.0, "min_mm": [1.0, 2.0, 3.0], "max_mm": [4.0, 5.0, 6.0]});
    let inverted = json!({"doubt": "inverted", "count": 3, "elements": 12, "area_mm2": 4.5, "largest": [place]});
    assert_eq!(field["report"]["bone"]["regions"], json!([inverted]));
    let body = json!({"points_mm": [[0, -70, 0], [0, 0, 50]], "solid": "bone"});
    let values = app.post(&format!("{session}/field/query"), body).await.ok();
    assert_eq!(values["distances_mm"], json!([10.0, -10.0]));
    assert_eq!(values["gradients"], json!([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]));
    assert_eq!(values["closest_points_mm"], json!([[0.0, -60.0, 0.0], [0.0, 0.0, 60.0]]));
    assert_eq!(values["triangles"], json!([7, 7]));
    let far = json!({"points_mm": [[0, 0, 1e30]]});
    let problem = app.post(&format!("{session}/field/query"), far).await.problem(422, "invalid-request");
    assert_eq!(problem["errors"][0]["pointer"], "/points_mm/0/2");
    let settings = format!("{session}/field/settings");
    for method in ["uniform", "frisken", "hybrid", "adaptive"] {
        app.put_json(&settings, json!({"method": method, "resolution": 64, "tolerance_mm": 0.05})).await.ok();
        let seen = app.get(&format!("{session}/field")).await.ok()["settings"].clone();
        assert_eq!(
            (&seen["method"], &seen["resolution"], &seen["tolerance_mm"]),
            (&json!(method), &json!(64), &json!(0.05))
        );
    }
    for (name, value) in [("spacing_mm", json!(0)), ("resolution", json!(4)), ("tolerance_mm", json!(0))] {
        let problem = app.put_json(&settings, json!({name: value})).await;
        assert_eq!(problem.problem(422, "invalid-request")["errors"][0]["pointer"], format!("/{name}"));
    }
}
