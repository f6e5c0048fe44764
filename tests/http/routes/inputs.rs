use std::io::Write;
use std::path::Path;

use axum::body::{Body, Bytes};
use axum::http::{Method, StatusCode};
use flate2::Compression;
use flate2::write::GzEncoder;
use futures::{StreamExt, stream};
use prosopon_contract::FaultKind;
use prosopon_geometry::{Point, TriMesh};
use serde_json::json;

use crate::support::app::{TestApp, warnings_of};
use crate::support::binary::Server;
use crate::support::dicom::{NAME, archive, slice, stack};
use crate::support::shapes::{cube, nifti, ply_with, skin, skull, stl};

fn files_below(path: &std::path::Path) -> usize {
    let below = |p: std::path::PathBuf| if p.is_dir() { files_below(&p) } else { 1 };
    std::fs::read_dir(path).map(|d| d.map(|e| below(e.unwrap().path())).sum()).unwrap_or(0)
}

#[tokio::test]
async fn an_uploaded_surface_is_measured_and_sent_in_every_format() {
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
async fn faulty_surfaces_are_refused_and_leave_no_files() {
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

/// A form with these parts: (head, content).
fn form(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let one = |(head, content): &(&str, &[u8])| {
        [b"--x-x\r\nContent-Disposition: form-data; ", head.as_bytes(), b"\r\n\r\n", content, b"\r\n"].concat()
    };
    [parts.iter().flat_map(one).collect::<Vec<u8>>(), b"--x-x--\r\n".to_vec()].concat()
}

const FORM: &str = "multipart/form-data; boundary=x-x";

#[tokio::test]
async fn a_form_with_one_file_is_read_as_the_file() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let send = async |part: &str, body: Vec<u8>| {
        app.call(Method::PUT, &format!("{session}/{part}"), &[("content-type", FORM)], body).await
    };
    for part in ["skin", "skull", "target", "bones/0"] {
        let plain = app.upload(&format!("{session}/{part}"), skin()).await.ok();
        let sent = send(part, form(&[("name=\"file\"; filename=\"skin.stl\"", &skin())])).await.ok();
        assert_eq!(sent, plain, "{part}");
    }
    // A form that arrives in pieces.
    let whole = form(&[("name=\"file\"; filename=\"skin.stl\"\r\nContent-Type: model/stl", &skin())]);
    let pieces: Vec<_> = whole.chunks(100).map(|c| Ok::<_, std::io::Error>(Bytes::copy_from_slice(c))).collect();
    let path = format!("{session}/skin");
    let answer = app.call(Method::PUT, &path, &[("content-type", FORM)], Body::from_stream(stream::iter(pieces))).await;
    assert_eq!(answer.ok()["triangles"], 12);
    let accepted = send("ct?bone_hu=250", form(&[("name=\"f\"; filename=\"head.nii\"", &nifti())])).await;
    assert_eq!(accepted.json()["kind"], "import", "{accepted:?}");
    app.finish(accepted).await;

    let before = files_below(&app.directory().join("blobs"));
    let file = ("name=\"file\"; filename=\"a.stl\"", &skin()[..]);
    for (body, words) in [
        (form(&[]), "has no file"),
        (form(&[file, file]), "several files"),
        (form(&[("name=\"series\"", b"2"), file]), "`series`"),
        (whole[..whole.len() / 2].to_vec(), "last boundary"),
        (skin(), "last boundary"),
    ] {
        let problem = send("skin", body).await.problem(400, "malformed-request");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{words}: {problem}");
    }
    let mixed = [("content-type", "multipart/mixed; boundary=x-x")];
    app.call(Method::PUT, &path, &mixed, whole).await.problem(415, "unsupported-format");
    assert_eq!(files_below(&app.directory().join("blobs")), before);
}

#[tokio::test]
async fn a_form_is_stopped_at_the_limit_of_its_file() {
    let app = TestApp::with(|config| config.limits.max_surface_bytes = 1 << 20).await;
    let path = format!("{}/skin", app.session().await);
    let head = Bytes::from_static(b"--x-x\r\nContent-Disposition: form-data; name=\"f\"; filename=\"a\"\r\n\r\n");
    // Four megabytes; the service reads and drops the rest of what it refuses.
    let zeros = || stream::repeat_with(|| Ok::<_, std::io::Error>(Bytes::from(vec![0u8; 1 << 16]))).take(64);
    let long = Body::from_stream(stream::once(async { Ok(head) }).chain(zeros()));
    app.call(Method::PUT, &path, &[("content-type", FORM)], long).await.problem(413, "too-large");
    let headless = Body::from_stream(zeros());
    app.call(Method::PUT, &path, &[("content-type", FORM)], headless).await.problem(400, "malformed-request");
    assert_eq!(files_below(&app.directory().join("blobs")), 0);
}

#[tokio::test]
async fn an_upload_with_too_large_a_length_is_refused_before_it_is_read() {
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
async fn an_interrupted_upload_leaves_no_files() {
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
    let warnings = warnings_of(&job);
    assert!(warnings.contains(&"a head-rest was removed".to_owned()), "{warnings:?}");
    assert!(warnings[0].contains("diagonal of 5.2 mm"), "the warning of the upload comes first: {warnings:?}");
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
async fn unusable_ct_files_are_refused() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let path = format!("{session}/ct");
    app.upload(&path, Vec::new()).await.problem(422, "volume-not-usable");
    app.upload(&path, skin()).await.problem(415, "unsupported-format");
    // A file that no import accepts is not stored.
    for level in ["skin_hu=400&bone_hu=300", "skin_hu=NaN", "bone_hu=inf", "max_error_mm=9"] {
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
        (broken(42, &20_000i16.to_le_bytes()), "bounding box has a diagonal"),
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
async fn flat_surfaces_are_refused_and_open_ones_accepted() {
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
async fn a_ct_is_failed_until_an_import_succeeds() {
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
async fn a_failed_import_keeps_what_the_reader_found() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let uneven = archive(&stack(&[0.0, 4.0, 8.0, 13.0, 17.0]));
    app.stand_in.fails_next(FaultKind::VolumeNotUsable, "there is no skin in it");
    for status in ["failed", "succeeded"] {
        let job = app.finish(app.upload(&format!("{session}/ct"), uneven.clone()).await).await;
        assert_eq!(job["status"], status, "{job}");
        let found = job["warnings"].as_array().unwrap().iter().filter(|w| w["code"] == "uneven-slices");
        assert_eq!(found.count(), 1, "{job}");
    }
}

#[tokio::test]
async fn one_of_several_stacks_is_chosen_and_a_scale_is_given() {
    let app = TestApp::new().await;
    let path = format!("{}/ct", app.session().await);
    let phase = |first: usize| (0..5).map(move |k| slice("1.2.3.4", first + k, 4.0 * k as f64));
    // The second phase has other values, and its direction tells it apart.
    let mut files: Vec<Vec<u8>> = phase(0).collect();
    let turned = |file: Vec<u8>| {
        let at = file.windows(12).position(|w| w == b"1\\0\\0\\0\\1\\0 ").unwrap();
        [&file[..at], b"0\\1\\0\\1\\0\\0 ", &file[at + 12..]].concat()
    };
    files.extend(phase(7).map(turned));
    let refused = app.upload(&path, archive(&files)).await.problem(422, "volume-not-usable");
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("choose one stack with `stack`: stack 1: 5 of 8 x 8 pixels"), "{detail}");
    assert!(!detail.contains(NAME), "{detail}");
    for (query, status) in [("stack=1", "succeeded"), ("stack=2&rescale_intercept=-24&rescale_slope=2", "succeeded")] {
        let job = app.finish(app.upload(&format!("{path}?{query}"), archive(&files)).await).await;
        assert_eq!(job["status"], status, "{job}");
        let notes = job["notes"].as_array().map_or(&[][..], Vec::as_slice);
        let has_note = notes.iter().any(|note| note["code"] == "rescale-given");
        assert_eq!(has_note, query.contains("rescale"), "{job}");
    }
    for query in ["stack=0", "volume=0", "rescale_slope=0", "rescale_intercept=1e7"] {
        app.upload(&format!("{path}?{query}"), archive(&files)).await.problem(422, "invalid-request");
    }
}

#[tokio::test]
async fn a_repeated_ct_returns_the_active_import() {
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
async fn a_surface_replaced_during_a_download_is_sent_whole() {
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

/// Whether any file below `path` contains `word`.
fn holds(path: &Path, word: &[u8]) -> bool {
    if path.is_dir() {
        return std::fs::read_dir(path).unwrap().any(|e| holds(&e.unwrap().path(), word));
    }
    std::fs::read(path).unwrap().windows(word.len()).any(|w| w == word)
}

#[tokio::test]
async fn no_patient_data_of_a_dicom_series_are_stored() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let mut files = stack(&[0.0, 4.0, 8.0, 12.0, 16.0]);
    files.extend((0..4).map(|k| slice("1.2.9", k, 4.0 * k as f64)));
    files.push(b"a note".to_vec());
    let job = app.finish(app.upload(&format!("{session}/ct"), archive(&files)).await).await;
    assert_eq!(job["status"], "succeeded");
    let warnings = format!("{} {}", job["warnings"], job["notes"]);
    for part in ["1 files that are not images", "series 1 was taken as the largest CT", "a head-rest was removed"] {
        assert!(warnings.contains(part), "{warnings}");
    }
    let report = app.get(&format!("{session}/skin?format=json")).await.ok();
    assert_eq!(report["origin"]["format"], "dicom");
    for word in [NAME, "1.2.3.4", "1.2.9"] {
        assert!(!holds(app.directory(), word.as_bytes()), "{word} was stored");
    }
    assert!(!warnings.contains("PATIENT") && !warnings.contains("1.2.3"), "{warnings}");
    // Number and identifier of the other series select the same volume.
    let by = async |series: &str| {
        app.finish(app.upload(&format!("{session}/ct?series={series}"), archive(&files)).await).await;
        app.get(&session).await.ok()["parts"]["ct"]["sha256"].clone()
    };
    assert_eq!(by("2").await, by("1.2.9").await);
}

#[tokio::test]
async fn unusable_dicom_series_are_refused() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let even = stack(&[0.0, 4.0, 8.0, 12.0]);
    let zip = archive(&even);
    let mut other_syntax = even.clone();
    let uid = other_syntax[2].windows(20).position(|w| w == b"1.2.840.10008.1.2.1\0").unwrap();
    other_syntax[2][uid..uid + 20].copy_from_slice(b"1.2.840.10008.1.2.9\0");
    let with_missing_bytes: Vec<Vec<u8>> = even.iter().map(|f| f[..f.len() - 30].to_vec()).collect();
    for (query, bytes, words) in [
        ("", archive(&stack(&[0.0, 4.0, 8.0, 20.0])), "Steps in mm: 4.00, 4.00, 12.00"),
        ("", archive(&other_syntax), "which is not supported"),
        ("", archive(&with_missing_bytes), "bytes, but"),
        ("", archive(&[b"a note".to_vec()]), "no DICOM images"),
        ("", even[0].clone(), "at least 4 along each axis"),
        ("", zip[..zip.len() - 40].to_vec(), "damaged or cut off"),
        ("", zip[..zip.len() / 2].to_vec(), "damaged or cut off"),
        ("?series=3", zip.clone(), "was not found"),
    ] {
        let problem = app.upload(&format!("{session}/ct{query}"), bytes).await.problem(422, "volume-not-usable");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{problem}");
        assert!(!problem.to_string().contains("PATIENT"), "{problem}");
    }
    let wide = app.upload(&format!("{session}/ct?max_step_mm=15"), archive(&stack(&[0.0, 4.0, 8.0, 20.0]))).await;
    assert_eq!(app.finish(wide).await["status"], "succeeded");
    app.upload(&format!("{session}/ct?max_step_mm=0"), zip).await.problem(422, "invalid-request");
    assert_eq!(app.get(&session).await.ok()["parts"]["ct"]["state"], json!("ready"));
}

#[tokio::test]
async fn notes_in_the_header_of_a_nifti_file_are_not_stored() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let mut file = nifti();
    // The field `descrip`.
    file[148..148 + NAME.len()].copy_from_slice(NAME.as_bytes());
    let job = app.finish(app.upload(&format!("{session}/ct"), file).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    assert!(!holds(app.directory(), NAME.as_bytes()), "the note was stored");
}

#[test]
fn the_binary_refuses_unusable_files_and_swapped_surfaces() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session();
    let whole = skin();
    let mut not_a_number = whole.clone();
    // The first vertex of the second triangle.
    not_a_number[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    for part in ["skin", "skull", "target"] {
        let path = format!("{session}/{part}");
        server.upload(&path, &[]).refused(422, "surface-not-usable", "empty");
        server.upload(&path, &whole[..whole.len() / 2]).refused(422, "surface-not-usable", "12");
        server.upload(&path, &not_a_number).refused(422, "surface-not-usable", "finite");
        server.upload(&path, &ply_with(&cube([0.0; 3], 100.0), "nan")).refused(422, "surface-not-usable", "vertex 0");
        server.get(&path).refused(404, "not-found", part);
    }
    server.upload(&format!("{session}/ct"), &[]).refused(422, "volume-not-usable", "empty");

    // Skin and skull are swapped; each alone is valid.
    server.upload(&format!("{session}/skin"), &skull()).ok();
    server.upload(&format!("{session}/skull"), &whole).ok();
    server.post(&format!("{session}/field"), &json!({})).refused(422, "anatomy-not-usable", "swapped");
    server.upload(&format!("{session}/skin"), &whole).ok();
    server.upload(&format!("{session}/skull"), &skull()).ok();
    server.finish(&server.post(&format!("{session}/field"), &json!({})));
}
