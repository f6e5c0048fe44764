use std::io::Write;

use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use flate2::Compression;
use flate2::write::GzEncoder;
use futures::stream;
use prosopon_geometry::{Point, TriMesh};
use prosopon_session::FaultKind;
use serde_json::json;

use crate::support::app::TestApp;
use crate::support::shapes::{cube, nifti, ply_with, skin, skull, stl};

fn files_below(path: &std::path::Path) -> usize {
    let below = |p: std::path::PathBuf| if p.is_dir() { files_below(&p) } else { 1 };
    std::fs::read_dir(path).map(|d| d.map(|e| below(e.unwrap().path())).sum()).unwrap_or(0)
}

#[tokio::test]
async fn an_uploaded_surface_is_measured_and_comes_back_in_every_format() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let path = format!("{session}/skin");
    app.get(&path).await.problem(404, "not-found");
    let report = app.upload(&path, skin()).await.ok();
    assert_eq!((&report["triangles"], &report["vertices"]), (&json!(12), &json!(8)));
    assert_eq!((&report["closed"], &report["open_edges"]), (&json!(true), &json!(0)));
    assert!((report["volume_mm3"].as_f64().unwrap() - 8e6).abs() < 1e-3);
    assert_eq!(app.get(&format!("{path}?format=json")).await.ok(), report);
    for (format, media_type, magic) in [
        ("glb", "model/gltf-binary", b"glTF".as_slice()),
        ("ply", "application/ply", b"ply\n".as_slice()),
        ("stl", "model/stl", b"".as_slice()),
        ("json", "application/json", b"{".as_slice()),
    ] {
        let answer = app.get(&format!("{path}?format={format}")).await;
        assert_eq!((answer.status, answer.header("content-type")), (StatusCode::OK, media_type));
        assert!(answer.body.starts_with(magic));
        if format != "json" {
            let accepted = app.call(Method::GET, &path, &[("accept", media_type)], Body::empty()).await;
            assert_eq!(accepted.body, answer.body);
        }
        let known = [("if-none-match", answer.header("etag"))];
        let again = app.call(Method::GET, &format!("{path}?format={format}"), &known, Body::empty()).await;
        assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0));
    }
    let refused = app.call(Method::GET, &path, &[("accept", "text/html")], Body::empty()).await;
    refused.problem(406, "not-acceptable");
    app.get(&format!("{path}?format=xyz")).await.problem(400, "malformed-request");
}

#[tokio::test]
async fn faulty_surfaces_are_refused_with_what_and_where_and_leave_nothing() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let path = format!("{session}/skin");
    let whole = skin();
    let check = async |bytes: Vec<u8>, status: u16, kind: &str, words: &str| {
        let problem = app.upload(&path, bytes).await.problem(status, kind);
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
    };
    check(Vec::new(), 422, "surface-not-usable", "empty").await;
    check(whole[..whole.len() - 30].to_vec(), 422, "surface-not-usable", "12").await;
    check(ply_with(&cube([0.0; 3], 100.0), "nan"), 422, "surface-not-usable", "vertex 0").await;
    check(b"<html>not a surface</html>".to_vec(), 415, "unsupported-format", "STL").await;
    check(vec![0xff; 5000], 415, "unsupported-format", "STL").await;
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
    // The service still works.
    app.upload(&path, whole).await.ok();
    assert_eq!(files_below(&app.directory().join("blobs")), 1);
    app.upload(&path, skull()).await.ok();
    assert_eq!(files_below(&app.directory().join("blobs")), 1, "the surface before is replaced");
}

#[tokio::test]
async fn an_upload_that_announces_too_much_is_refused_at_once() {
    let app = TestApp::new().await;
    let session = app.session().await;
    for (part, allowed) in [("ct", 2u64 << 30), ("skin", 512 << 20)] {
        // The header announces three gigabytes; no byte is sent.
        let never = Body::from_stream(stream::pending::<Result<Bytes, std::io::Error>>());
        let headers = [("content-length", "3221225472")];
        let answer = app.call(Method::PUT, &format!("{session}/{part}"), &headers, never).await;
        let problem = answer.problem(413, "too-large");
        assert_eq!(problem["allowed_bytes"], allowed);
    }
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
}

#[tokio::test]
async fn an_upload_without_length_is_stopped_at_the_limit() {
    let app = TestApp::with(|config| config.limits.max_surface_bytes = 1 << 20).await;
    let session = app.session().await;
    let endless = stream::repeat_with(|| Ok::<_, std::io::Error>(Bytes::from(vec![0u8; 1 << 16])));
    let answer = app.call(Method::PUT, &format!("{session}/skin"), &[], Body::from_stream(endless)).await;
    answer.problem(413, "too-large");
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
}

#[tokio::test]
async fn an_upload_that_breaks_off_leaves_nothing() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let pieces = vec![Ok(Bytes::from_static(b"solid")), Err(std::io::Error::other("gone"))];
    let answer = app.call(Method::PUT, &format!("{session}/skin"), &[], Body::from_stream(stream::iter(pieces))).await;
    answer.problem(400, "malformed-request");
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
}

#[tokio::test]
async fn a_ct_becomes_skin_skull_and_air() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let accepted = app.upload(&format!("{session}/ct?bone_hu=250"), nifti()).await;
    assert_eq!(accepted.header("retry-after"), "1");
    assert_eq!(accepted.json()["kind"], "import");
    let job = app.finish(accepted).await;
    assert_eq!(job["status"], "succeeded");
    let warnings = job["warnings"].as_array().unwrap();
    assert!(warnings.contains(&json!("a head-rest was removed")), "{warnings:?}");
    assert!(
        warnings[0].as_str().unwrap().contains("5.2 mm across"),
        "what the upload was told comes first: {warnings:?}"
    );
    let parts = app.get(&session).await.ok()["parts"].clone();
    for part in ["ct", "skin", "skull", "air"] {
        assert_eq!(parts[part]["state"], "ready", "{part}");
    }
    let report = app.get(&format!("{session}/skin?format=json")).await.ok();
    assert_eq!(report["origin"]["kind"], "ct");
    assert_eq!(
        report["origin"]["sha256"],
        prosopon_store::sha256_hex(&nifti()),
        "of the upload; of a CT something else is kept"
    );

    // The time of the import counts once in a report, although it gave three surfaces.
    let import_s = parts["skin"]["wall_s"].as_f64().unwrap();
    app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    let plan = app.plan(&session).await;
    let job = app.solve(&session, &plan, json!({})).await;
    assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
    let phases = app.get(&format!("{job}/report")).await.ok()["phases"].clone();
    assert!(import_s > 0.0 && phases["surfaces_s"] == import_s, "{import_s} {phases}");
    let members = phases.as_object().unwrap();
    let sum: f64 = members.iter().filter(|(name, _)| *name != "total_s").map(|(_, s)| s.as_f64().unwrap()).sum();
    assert!((sum - phases["total_s"].as_f64().unwrap()).abs() < 1e-9, "{phases}");
}

#[tokio::test]
async fn a_file_that_is_no_ct_is_refused() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let path = format!("{session}/ct");
    app.upload(&path, Vec::new()).await.problem(422, "volume-not-usable");
    app.upload(&path, skin()).await.problem(415, "unsupported-format");
    // A file that no import accepts is not stored.
    for level in ["skin_hu=400", "skin_hu=-950", "bone_hu=50", "bone_hu=2900"] {
        app.upload(&format!("{path}?{level}"), nifti()).await.problem(422, "invalid-request");
    }
    app.upload(&format!("{path}?skin=400"), nifti()).await.problem(400, "malformed-request");
    let broken = |at: usize, bytes: &[u8]| {
        let mut file = nifti();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    let cut_off = nifti()[..360].to_vec();
    let zipped = gzipped(&nifti());
    let damaged = [[0x1f, 0x8b].as_slice(), &[0; 20]].concat();
    for (file, words) in [
        (broken(344, b"xyz\0"), "header"),
        (broken(42, &0i16.to_le_bytes()), "dimensions"),
        (broken(42, &20_000i16.to_le_bytes()), "mm across"),
        (broken(42, &200i16.to_le_bytes()), "cut off"),
        (broken(70, &1i16.to_le_bytes()), "data type"),
        (cut_off, "cut off"),
        (damaged, "gzip"),
        (gzipped(&nifti()[..nifti().len() - 1]), "cut off"),
        (zipped[..zipped.len() / 2].to_vec(), "cut off"),
        (zipped[..zipped.len() - 1].to_vec(), "gzip"),
    ] {
        let problem = app.upload(&path, file).await.problem(422, "volume-not-usable");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
        assert_eq!(problem["errors"][0]["pointer"], "/ct");
    }
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
    assert_eq!(app.get("/v1/jobs").await.ok()["jobs"], json!([]));
}

#[tokio::test]
async fn surfaces_that_bound_nothing_are_refused_and_open_ones_are_taken() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let whole = cube([0.0; 3], 100.0);
    let some = |triangles: std::ops::Range<usize>| {
        stl(&TriMesh::new(whole.positions().to_vec(), whole.triangles()[triangles].to_vec()).unwrap())
    };
    for part in ["skin", "skull", "target"] {
        let path = format!("{session}/{part}");
        for (file, words) in [(some(0..1), "solid: 1,"), (some(0..3), "solid: 3,"), (flat(), "one plane")] {
            let problem = app.upload(&path, file).await.problem(422, "surface-not-usable");
            assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
            assert_eq!(problem["errors"][0]["pointer"], format!("/{part}"));
        }
        app.get(&path).await.problem(404, "not-found");
        let open = app.upload(&path, some(2..12)).await.ok();
        assert_eq!((&open["closed"], &open["open_edges"]), (&json!(false), &json!(4)));
    }
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A square of four triangles.
fn flat() -> Vec<u8> {
    let corners = [[0., 0., 0.], [100., 0., 0.], [100., 100., 0.], [0., 100., 0.], [50., 50., 0.]];
    let triangles = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    stl(&TriMesh::new(corners.map(Point::from).to_vec(), triangles).unwrap())
}

#[tokio::test]
async fn a_ct_without_surfaces_is_told_until_an_import_succeeds() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let state = async || app.get(&session).await.ok()["parts"]["ct"]["state"].clone();
    app.stand_in.fails_next(FaultKind::VolumeNotUsable, "there is no skin in it");
    let job = app.finish(app.upload(&format!("{session}/ct"), nifti()).await).await;
    assert_eq!((&job["status"], state().await), (&json!("failed"), json!("failed")), "{job}");
    assert_eq!(app.get("/v1/sessions").await.ok()["sessions"][0]["parts"]["ct"]["state"], "failed");
    let job = app.finish(app.upload(&format!("{session}/ct"), nifti()).await).await;
    assert_eq!((&job["status"], state().await), (&json!("succeeded"), json!("ready")), "{job}");

    // A job that is cancelled before its start does not change it.
    let (other, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(1);
    let running = app.solve(&other, &plan, json!({})).await;
    app.until_step(&running, 1).await;
    let waiting = app.upload(&format!("{session}/ct?skin_hu=-250"), nifti()).await;
    app.post(&format!("{}/cancel", waiting.header("location")), json!({})).await.ok();
    assert_eq!(state().await, "ready");
    app.stand_in.release();
}

#[tokio::test]
async fn the_same_ct_again_is_the_same_import() {
    let app = TestApp::new().await;
    let (session, plan) = app.session_with_plan().await;
    app.stand_in.hold_after(0);
    let running = app.solve(&session, &plan, json!({})).await;
    let path = format!("{}/ct", app.session().await);
    let first = app.upload(&path, nifti()).await;
    let again = app.upload(&path, nifti()).await;
    assert_eq!((again.status, again.header("location")), (StatusCode::ACCEPTED, first.header("location")));
    let other = app.upload(&format!("{path}?bone_hu=250"), nifti()).await;
    assert_ne!(other.header("location"), first.header("location"));
    app.stand_in.release();
    app.ended(&running).await.ok();
    for job in [first, other] {
        assert_eq!(app.finish(job).await["status"], "succeeded");
    }
}

#[tokio::test]
async fn a_surface_that_is_replaced_while_it_is_sent_comes_all_the_same() {
    let app = TestApp::new().await;
    let path = format!("{}/skin", app.session().await);
    app.upload(&path, skin()).await.ok();
    for round in 0..40 {
        let (put, one, other) = tokio::join!(
            app.upload(&path, if round % 2 == 0 { skull() } else { skin() }),
            app.get(&path),
            app.get(&path)
        );
        for answer in [put, one, other] {
            assert_eq!(answer.status, StatusCode::OK, "{answer:?}");
        }
    }
}

#[tokio::test]
async fn landmarks_are_checked_and_kept() {
    let app = TestApp::new().await;
    let path = format!("{}/landmarks", app.session().await);
    app.get(&path).await.problem(404, "not-found");
    let landmarks = json!({
        "points": {"ans": [6, -84, 45]}, "midline_x_mm": 6, "occlusal_plane_z_mm": 17,
        "le_fort_1_plane": {"point_mm": [6, -60, 38], "normal": [0, 0, 2]}
    });
    let stored = app.put_json(&path, landmarks).await.ok();
    assert_eq!(stored["le_fort_1_plane"]["normal"], json!([0.0, 0.0, 1.0]));
    let missing = app.put_json(&path, json!({})).await.problem(422, "invalid-request");
    assert!(missing["detail"].as_str().unwrap().contains("points"), "{missing}");
    assert_eq!(app.get(&path).await.ok(), stored);

    let faulty = json!({
        "points": {"ans": [1e9, 0, 0], "Nose Tip": [0, 0, 0]},
        "le_fort_1_plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 0]}
    });
    let problem = app.put_json(&path, faulty).await.problem(422, "invalid-request");
    let pointers: Vec<&str> =
        problem["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap()).collect();
    assert_eq!(pointers, ["/points/Nose Tip", "/points/ans/0", "/le_fort_1_plane/normal"]);

    // A head in metres is smaller than a tooth, one in micrometres larger than a room.
    let scaled = |scale: f64| {
        let points = [("ans", [6.0, -84.0, 45.0]), ("pogonion", [6.0, -71.0, -25.0]), ("menton", [6.0, -67.0, -33.0])];
        let points: serde_json::Map<_, _> =
            points.into_iter().map(|(name, p)| (name.to_owned(), json!(p.map(|c| c * scale)))).collect();
        json!({ "points": points })
    };
    for (scale, ok) in [(1.0, true), (1e-3, false), (50.0, false)] {
        let answer = app.put_json(&path, scaled(scale)).await;
        assert_eq!(answer.status.is_success(), ok, "{scale}");
        if !ok {
            let problem = answer.problem(422, "invalid-request");
            assert_eq!(problem["errors"][0]["pointer"], "/points");
            assert!(problem["detail"].as_str().unwrap().contains("are in mm"), "{problem}");
        }
    }
    let two = json!({"points": {"ans": [0.006, -0.084, 0.045], "pogonion": [0.006, -0.071, -0.025]}});
    app.put_json(&path, two).await.problem(422, "invalid-request");
}

#[tokio::test]
async fn a_skin_inside_the_skull_is_refused_by_the_field() {
    let app = TestApp::new().await;
    let session = app.session().await;
    app.upload(&format!("{session}/skin"), skull()).await.ok();
    let refused = async |skull| {
        app.upload(&format!("{session}/skull"), stl(&skull)).await.ok();
        let problem = app.post(&format!("{session}/field"), json!({})).await.problem(422, "anatomy-not-usable");
        problem["detail"].as_str().unwrap().to_owned()
    };
    assert!(refused(cube([0.0; 3], 200.0)).await.contains("swapped"));
    assert!(refused(cube([0.0, 0.0, 500.0], 60.0)).await.contains("apart"));
    // When the bounding boxes cross, the numerics decide; here the skull is larger than the skin.
    app.upload(&format!("{session}/skull"), stl(&cube([150.0, 0.0, 0.0], 200.0))).await.ok();
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!((&job["status"], &job["problem"]["status"]), (&json!("failed"), &json!(422)));
    assert_eq!(job["problem"]["type"], "/problems/anatomy-not-usable");
    assert_eq!(job["phase"], "field", "where it failed");
}
