//! Comparisons of stored surfaces, most of them with the real numerics.

use std::time::Duration;

use axum::http::Method;
use prosopon_geometry::{Motion, TriMesh, Vector};
use serde_json::{Value, json};

use super::results::solved;
use crate::support::app::{Answer, TestApp};
use crate::support::shapes::{cube, lumpy, stl};

/// Creates a session with this skin and target; returns its id.
async fn session_of(app: &TestApp, skin: &TriMesh, target: &TriMesh) -> String {
    let session = app.session().await;
    for (name, mesh) in [("skin", skin), ("target", target)] {
        app.upload(&format!("{session}/{name}"), stl(mesh)).await.ok();
    }
    session.rsplit('/').next().unwrap().to_owned()
}

/// Body of a comparison of skin with target, with further members.
fn body(session: &str, more: &Value) -> Value {
    let mut body = json!({
        "prediction": {"session": session, "part": "skin"},
        "reference": {"session": session, "part": "target"},
    });
    body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    body
}

async fn compare(app: &TestApp, session: &str, more: Value) -> Answer {
    post(app, "/v1/compare", body(session, &more)).await
}

/// Waits for the comparison without a time limit.
async fn post(app: &TestApp, path: &str, body: Value) -> Answer {
    let headers = [("content-type", "application/json"), ("prefer", "wait=60")];
    app.call(Method::POST, path, &headers, body.to_string()).await
}

#[tokio::test]
async fn a_comparison_is_waited_for_or_fetched_from_its_job() {
    let app = TestApp::real().await;
    let session = session_of(&app, &lumpy(24, |_| 0.0), &lumpy(24, |d| 2.0 * d[1])).await;
    let headers = [("content-type", "application/json"), ("prefer", "respond-async")];
    let asked = app.call(Method::POST, "/v1/compare", &headers, body(&session, &json!({})).to_string()).await;
    let job = app.finish(asked).await;
    assert_eq!(
        (&job["kind"], &job["status"], &job["session"]),
        (&json!("compare"), &json!("succeeded"), &json!(session))
    );
    let path = job["links"]["comparison"].as_str().unwrap();
    let fetched = app.get(path).await;
    let waited = compare(&app, &session, json!({})).await;
    assert_eq!(fetched.ok(), waited.ok());
    assert!(waited.header("content-location").ends_with("/comparison"));
    let tag = fetched.header("etag").to_owned();
    let known = app.call(Method::GET, path, &[("if-none-match", &tag)], axum::body::Body::empty()).await;
    assert_eq!(known.status.as_u16(), 304);
    assert!(app.get(&format!("{path}?values=true")).await.ok()["values_mm"].is_array());
    assert_eq!(app.get(&format!("{path}?format=png")).await.header("content-type"), "image/png");
    let mesh = app.post(&format!("/v1/sessions/{session}/field"), json!({})).await;
    mesh.problem(409, "missing-input");
}

#[tokio::test]
async fn a_repeated_comparison_returns_the_present_state_of_its_job() {
    let app = TestApp::real().await;
    let session = session_of(&app, &lumpy(24, |_| 0.0), &lumpy(24, |d| 2.0 * d[1])).await;
    let text = body(&session, &json!({})).to_string();
    let ask = async |prefer: &str| {
        let headers = [("content-type", "application/json"), ("prefer", prefer), ("idempotency-key", "c1")];
        app.call(Method::POST, "/v1/compare", &headers, text.clone()).await
    };
    let first = ask("respond-async").await;
    assert_eq!(first.status.as_u16(), 202);
    let path = format!("{}/comparison", first.header("location"));
    let again = ask("wait=60").await;
    assert_eq!((again.status.as_u16(), again.header("idempotency-replayed")), (200, "true"));
    assert_eq!(again.header("content-location"), path);
    assert_eq!(again.ok(), app.get(&path).await.ok());
    assert_eq!(app.get("/v1/jobs").await.ok()["jobs"].as_array().unwrap().len(), 1, "no second job");
    let headers = [("content-type", "application/json"), ("idempotency-key", "c1")];
    let other = body(&session, &json!({"values": true})).to_string();
    app.call(Method::POST, "/v1/compare", &headers, other).await.problem(422, "idempotency-mismatch");
}

#[tokio::test]
async fn results_of_comparisons_expire() {
    let app = TestApp::with(|config| config.service.comparison_retention = Duration::ZERO).await;
    let session = session_of(&app, &lumpy(24, |_| 0.0), &lumpy(24, |_| 0.0)).await;
    let own = format!("/v1/sessions/{session}");
    let bytes = async || app.get(&own).await.ok()["bytes"].as_u64().unwrap();
    let before = bytes().await;
    let found = compare(&app, &session, json!({})).await;
    let path = found.header("content-location").to_owned();
    assert!(bytes().await > before && app.get(&path).await.status.is_success());
    tokio::time::sleep(Duration::from_millis(5)).await;
    app.state.service.run_maintenance().await.unwrap();
    app.get(&path).await.problem(410, "gone");
    assert_eq!(bytes().await, before);
    let job = app.get(path.strip_suffix("/comparison").unwrap()).await.ok();
    assert_eq!((&job["status"], &job["links"]["comparison"]), (&json!("succeeded"), &json!(null)));
    compare(&app, &session, json!({})).await.ok();
}

/// A comparison that is ended while it runs leaves nothing, and the next one succeeds.
#[tokio::test]
async fn an_interrupted_comparison_leaves_no_files() {
    let app = TestApp::real().await;
    let fine = |turn: f64| lumpy(300, move |d| turn * d[1]);
    let own = session_of(&app, &fine(0.0), &fine(1.0)).await;
    let other = session_of(&app, &fine(0.5), &fine(0.0)).await;
    let path = format!("/v1/sessions/{own}");
    let bytes = app.get(&path).await.ok()["bytes"].clone();
    let headers = [("content-type", "application/json"), ("prefer", "respond-async")];
    let ask = async |more: Value| app.call(Method::POST, "/v1/compare", &headers, body(&own, &more).to_string()).await;
    let between = json!({"reference": {"session": other, "part": "skin"}});

    let cancelled = ask(json!({"register": {}})).await.header("location").to_owned();
    assert!(app.post(&format!("{cancelled}/cancel"), json!({})).await.status.is_success());
    let ended = app.ended(&cancelled).await.ok();
    assert_eq!((&ended["status"], &app.get(&path).await.ok()["bytes"]), (&json!("cancelled"), &bytes), "{ended}");

    let lost = ask(between).await.header("location").to_owned();
    app.delete(&format!("/v1/sessions/{other}?at_once=true")).await;
    app.ended(&lost).await.problem(410, "gone");
    let done = compare(&app, &own, json!({})).await;
    done.ok();
    let with_one = app.get(&path).await.ok()["bytes"].as_u64().unwrap();
    assert!(with_one > bytes.as_u64().unwrap());
    // Skin, target, and the two files of the result.
    assert_eq!(std::fs::read_dir(app.directory().join("blobs").join(&own)).unwrap().count(), 4);
}

/// Deleting the session of the reference also deletes the comparisons made with it.
#[tokio::test]
async fn a_comparison_is_deleted_with_either_session() {
    let app = TestApp::real().await;
    let own = session_of(&app, &lumpy(24, |_| 0.0), &lumpy(24, |_| 0.0)).await;
    let other = session_of(&app, &lumpy(24, |d| d[1]), &lumpy(24, |_| 0.0)).await;
    let between = json!({"reference": {"session": other, "part": "skin"}});
    let found = compare(&app, &own, between).await;
    let path = found.header("content-location").to_owned();
    assert_eq!(app.get(&path).await.status.as_u16(), 200);
    let bytes = app.get(&format!("/v1/sessions/{own}")).await.ok()["bytes"].as_u64().unwrap();
    assert_eq!(app.delete(&format!("/v1/sessions/{other}?at_once=true")).await.status.as_u16(), 204);
    app.get(&path).await.problem(410, "gone");
    assert!(app.get(&format!("/v1/sessions/{own}")).await.ok()["bytes"].as_u64().unwrap() < bytes);
}

#[tokio::test]
async fn the_error_of_a_registered_scan_is_its_bump() {
    let app = TestApp::real().await;
    // The operation raised the front by up to 3 mm; the scan has other triangles and another position.
    let bump = |d: [f64; 3]| 3.0 * ((-d[1] - 0.6) / 0.4).clamp(0.0, 1.0);
    let away = Motion::new(Vector::new(3.0, -3.0, 2.0), Vector::new(0.05, -0.04, 0.06));
    let session = session_of(&app, &lumpy(60, |_| 0.0), &lumpy(52, bump).moved(&away)).await;
    let altered = json!([{"centre_mm": [0, -90, 0], "radius_mm": 80}]);
    let found = compare(&app, &session, json!({"register": {"altered": altered}})).await.ok();
    let r = &found["registration"];
    let number = |v: &Value| v.as_f64().unwrap();
    let angle = away.rotation.angle().to_degrees();
    assert!((number(&r["angle_deg"]) - angle).abs() < 0.1, "{r}");
    for axis in 0..3 {
        assert!((number(&r["translation_mm"][axis]) - away.translation.vector[axis]).abs() < 0.1, "{r}");
    }
    assert_eq!(r["region"], "given");
    assert!(number(&r["residual_mm"]) < 0.1 && number(&r["overlap"]) > 0.8 && number(&r["iterations"]) >= 1.0, "{r}");
    // The bump is 3 mm high in the direction -y; there the prediction lies behind the reference.
    let max = number(&found["whole"]["max_mm"]);
    assert!((max - 3.0).abs() < 0.15 && number(&found["whole"]["mean_mm"]) < 0.0, "{}", found["whole"]);
    assert!(number(&found["smoothed"]["max_mm"]) <= max + 1e-9 && found["correspondence"].is_null());
    // Without registration the displacement of the scan is part of the error.
    let raw = compare(&app, &session, json!({})).await.ok();
    assert!(number(&raw["whole"]["mean_abs_mm"]) > 2.0 * number(&found["whole"]["mean_abs_mm"]));
    assert!(raw["registration"].is_null());
}

#[tokio::test]
async fn masks_select_and_exclusions_remove_vertices() {
    let app = TestApp::real().await;
    let skin = lumpy(30, |_| 0.0);
    let session = session_of(&app, &skin, &lumpy(30, |d| if d[2] > 0.0 { 1.0 } else { 0.0 })).await;
    let count = async |more: Value| compare(&app, &session, more).await.ok()["whole"]["count"].as_u64().unwrap();
    let n = count(json!({})).await;
    let upper = json!([{"min_mm": [-200, -200, 1], "max_mm": [200, 200, 200]}]);
    let half = count(json!({"mask": upper})).await;
    assert!(half > n / 3 && half < n * 2 / 3, "{half} of {n}");
    let eye = json!([{"centre_mm": [0, 0, 80], "radius_mm": 30}]);
    let without = count(json!({"mask": upper, "exclude": eye})).await;
    assert!(without < half && without > half / 2, "{without} of {half}");
    // With an adult's landmarks on a head of 80 mm, the eyes lie on the head.
    let marks = json!({"points": {"pronasale": [0, -95, 0], "menton": [0, -80, -87]}});
    app.put_json(&format!("/v1/sessions/{session}/landmarks"), marks).await.ok();
    let sighted = count(json!({"exclude_eyes": true})).await;
    assert!(sighted < n && sighted > n * 9 / 10, "{sighted} of {n}");
    let one_in_two: Vec<bool> = (0..n).map(|v| v % 2 == 0).collect();
    assert_eq!(count(json!({"mask_vertices": one_in_two})).await, n.div_ceil(2));
    let seen = compare(&app, &session, json!({"mask": upper, "values": true})).await.ok();
    assert_eq!((&seen["mask"], seen["values_mm"].as_array().unwrap().len() as u64), (&json!("given"), n));
    // With the same triangles, corresponding points are known.
    assert_eq!(seen["correspondence_mm"].as_array().unwrap().len() as u64, n);
    assert!(seen["correspondence"]["p50_mm"].as_f64().unwrap() > 0.9);
    let nobody = json!({"mask_vertices": vec![false; n as usize]});
    compare(&app, &session, nobody).await.problem(422, "comparison-not-usable");
}

#[tokio::test]
async fn a_surface_has_no_error_against_itself() {
    let app = TestApp::real().await;
    let skin = lumpy(30, |_| 0.0);
    let session = session_of(&app, &skin, &skin).await;
    let found = compare(&app, &session, json!({})).await.ok();
    for name in ["whole", "backward", "smoothed", "correspondence"] {
        assert_eq!((&found[name]["max_mm"], &found[name]["l2_norm_mm"]), (&json!(0.0), &json!(0.0)), "{name}");
    }
    assert_eq!((&found["excluded"], &found["warnings"]), (&json!(0), &json!([])));
}

#[tokio::test]
async fn unusable_comparisons_are_refused_with_a_reason() {
    let app = TestApp::real().await;
    let lump = lumpy(30, |_| 0.0);
    let session = session_of(&app, &lump, &lump).await;
    let failed = async |session: &str, register: Value| {
        compare(&app, session, json!({"register": register})).await.problem(422, "registration-failed")
    };
    let small = json!({"unaltered": [{"centre_mm": [0, 0, 80], "radius_mm": 2}]});
    let problem = failed(&session, small).await;
    assert_eq!(problem["reason"], "region_too_small");
    let ball = lumpy(30, |d| {
        let lumps =
            12.0 * d[0] * d[1] + 9.0 * d[2] * d[2] * d[0] - 15.0 * d[1].powi(3) + 6.0 * (5.0 * d[0]).sin() * d[2];
        -lumps
    });
    let round = session_of(&app, &ball, &ball).await;
    assert_eq!(failed(&round, json!({})).await["reason"], "slides");
    let strangers = session_of(&app, &lump, &cube([0.0; 3], 60.0)).await;
    assert_eq!(failed(&strangers, json!({})).await["reason"], "no_match");
    // Surfaces in different units, each of an accepted size.
    let scaled = |by: f64| lump.with_positions(lump.positions().iter().map(|p| p * by).collect()).unwrap();
    let metres = session_of(&app, &scaled(7.0), &scaled(0.03)).await;
    for more in [json!({}), json!({"register": {}})] {
        let problem = compare(&app, &metres, more).await.problem(422, "comparison-not-usable");
        assert!(problem["detail"].as_str().unwrap().contains("metres"), "{problem}");
    }
    // Surfaces far apart give an answer with a warning.
    let far = session_of(&app, &lump, &lump.moved(&Motion::translation(500.0, 0.0, 0.0))).await;
    let warnings = compare(&app, &far, json!({})).await.ok()["warnings"].to_string();
    assert!(warnings.contains("surfaces-apart") && warnings.contains("not-registered"), "{warnings}");
}

#[tokio::test]
async fn invalid_members_are_refused_with_their_pointer() {
    let app = TestApp::real().await;
    let lump = lumpy(12, |_| 0.0);
    let session = session_of(&app, &lump, &lump).await;
    for (more, pointer) in [
        (json!({"mask": [{"centre_mm": [0, 0, 0]}]}), "/mask/0"),
        (json!({"mask": [{"min_mm": [0, 0, 0], "max_mm": [1, 1, 1], "radius_mm": 2}]}), "/mask/0"),
        (json!({"exclude": [{"centre_mm": [0, 0, 0], "radius_mm": -1}]}), "/exclude/0/radius_mm"),
        (json!({"register": {"altered": [{"min_mm": [0, 0, 0], "max_mm": [1, -1, 1]}]}}), "/register/altered/0"),
        (
            json!({"register": {"unaltered": [{"centre_mm": [0, 1e9, 0], "radius_mm": 1}]}}),
            "/register/unaltered/0/centre_mm/1",
        ),
        (json!({"register": {"threshold_mm": 0}}), "/register/threshold_mm"),
        (json!({"mask_vertices": [true]}), "/mask_vertices"),
        (json!({"register": {"unaltered_vertices": [true]}}), "/register/unaltered_vertices"),
    ] {
        let problem = compare(&app, &session, more).await.problem(422, "invalid-request");
        assert_eq!(problem["errors"][0]["pointer"], pointer, "{problem}");
    }
    // JSON has no NaN; null, numbers and strings are not allowed.
    for wrong in [json!([null]), json!([0.5]), json!(["NaN"])] {
        let answer = compare(&app, &session, json!({"mask_vertices": wrong})).await;
        assert!(answer.status.is_client_error(), "{answer:?}");
    }
}

#[tokio::test]
async fn a_comparison_is_sent_as_picture_or_surface() {
    let app = TestApp::real().await;
    let session = session_of(&app, &lumpy(24, |_| 0.0), &lumpy(24, |d| 2.0 * d[1])).await;
    for (format, kind, magic) in [
        ("png", "image/png", "\u{89}PNG"),
        ("glb", "model/gltf-binary", "glTF"),
        ("ply", "application/ply", "ply\n"),
        ("vtp", "application/vnd.vtk.vtp", "<?xml"),
    ] {
        let path = format!("/v1/compare?format={format}");
        let answer = post(&app, &path, body(&session, &json!({}))).await;
        assert!(answer.status.is_success(), "{format}: {answer:?}");
        assert_eq!(answer.header("content-type"), kind);
        let start: String = answer.body.iter().take(magic.chars().count()).map(|b| char::from(*b)).collect();
        assert_eq!(start, magic);
        if matches!(format, "ply" | "vtp") {
            assert!(String::from_utf8_lossy(&answer.body[..2000]).contains("error_mm"), "{format}");
        }
    }
    app.post("/v1/compare?format=bmp", body(&session, &json!({}))).await.problem(400, "malformed-request");
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
