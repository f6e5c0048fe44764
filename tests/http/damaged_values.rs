//! Changed or truncated files of stored values never give a wrong answer.

use std::path::{Path, PathBuf};

use axum::http::StatusCode;
use prosopon_jobs::Scrubbed;
use serde_json::{Value, json};

use crate::support::app::TestApp;
use crate::support::shapes::{cube, nifti, skin, skull, stl};

/// Every file of a value, relative to the store.
fn values(directory: &Path) -> Vec<PathBuf> {
    let files = |path: &Path| std::fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect::<Vec<_>>();
    files(&directory.join("blobs")).iter().filter(|p| p.is_dir()).flat_map(|p| files(p)).collect()
}

fn flip_a_bit(file: &Path) {
    let mut bytes = std::fs::read(file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(file, bytes).unwrap();
}

fn cut_off(file: &Path) {
    let bytes = std::fs::read(file).unwrap();
    std::fs::write(file, &bytes[..bytes.len() - 1]).unwrap();
}

#[tokio::test]
async fn a_damaged_value_is_never_sent_and_nothing_is_computed_from_it() {
    for damage in [flip_a_bit, cut_off] {
        let app = TestApp::new().await;
        let (session, plan) = app.session_with_plan().await;
        app.upload(&format!("{session}/target"), skin()).await.ok();
        let job = app.solve(&session, &plan, json!({"steps": 1, "outputs": ["skin", "error", "tissue"]})).await;
        assert_eq!(app.ended(&job).await.ok()["status"], "succeeded");
        let osteotomy = app.get(&format!("{session}/osteotomies")).await.ok()["osteotomies"][0]["id"].clone();
        let osteotomy = format!("{session}/osteotomies/{}/segments/1", osteotomy.as_str().unwrap());
        let stored: Vec<String> = ["steps/1/frame", "steps/1/skin", "steps/1/skin?format=ply", "topology", "tissue"]
            .iter()
            .map(|path| format!("{job}/{path}"))
            .chain([format!("{session}/skin"), format!("{session}/skull?format=stl"), osteotomy])
            .collect();
        for path in &stored {
            assert_eq!(app.get(path).await.status, StatusCode::OK, "{path}");
        }
        values(app.directory()).iter().for_each(|file| damage(file));
        for path in &stored {
            let problem = app.get(path).await.problem(500, "damaged-value");
            assert!(problem["value"].as_str().unwrap().ends_with(".sealed"), "{problem}");
        }
        // A partial read is checked like a read of the whole value.
        let ranged = app.call(axum::http::Method::GET, &stored[0], &[("range", "bytes=0-3")], "").await;
        ranged.problem(500, "damaged-value");
        assert_eq!(app.get(&format!("{session}/skin")).await.json()["part"], "skin");
        let failed = app.solve(&session, &plan, json!({"steps": 1})).await;
        let failed = app.ended(&failed).await.ok();
        assert_eq!(
            (&failed["status"], &failed["problem"]["type"]),
            (&json!("failed"), &json!("/problems/damaged-value"))
        );
        // A new upload replaces the damaged value.
        app.upload(&format!("{session}/skin"), skin()).await.ok();
        assert_eq!(app.get(&format!("{session}/skin")).await.status, StatusCode::OK);
    }
}

#[tokio::test]
async fn damaged_surfaces_of_a_ct_are_rebuilt_with_a_warning() {
    let app = TestApp::new().await;
    let session = app.session().await;
    app.finish(app.upload(&format!("{session}/ct"), nifti()).await).await;
    let part = async |name: &str| app.get(&session).await.ok()["parts"][name]["sha256"].clone();
    let before = (part("skin").await, part("skull").await);
    // Names ascend with time, so the CT is first.
    let ct = values(app.directory()).into_iter().min().unwrap();
    values(app.directory()).iter().filter(|file| **file != ct).for_each(|file| flip_a_bit(file));
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    assert!(job["notes"].to_string().contains("was damaged and was made again from the CT"), "{job}");
    assert_eq!((part("skin").await, part("skull").await), before);
    assert_eq!(app.get(&format!("{session}/skull")).await.status, StatusCode::OK);

    // A skull uploaded later remains when the skin is rebuilt.
    let own = stl(&cube([0.0; 3], 50.0));
    app.upload(&format!("{session}/skull"), own).await.ok();
    let uploaded = part("skull").await;
    let newest = values(app.directory()).into_iter().max().unwrap();
    values(app.directory()).iter().filter(|file| **file != ct && **file != newest).for_each(|file| flip_a_bit(file));
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    assert_eq!((part("skin").await, part("skull").await), (before.0, uploaded.clone()));
    // The uploaded skull does not come from a CT.
    flip_a_bit(&newest);
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!((&job["status"], &job["problem"]["part"]), (&json!("failed"), &json!("skull")), "{job}");
    assert_eq!(part("skull").await, uploaded);
    app.upload(&format!("{session}/skull"), skull()).await.ok();

    values(app.directory()).iter().for_each(|file| flip_a_bit(file));
    let job = app.finish(app.post(&format!("{session}/field"), json!({})).await).await;
    assert_eq!((&job["status"], &job["problem"]["part"]), (&json!("failed"), &json!("ct")), "{job}");
}

#[tokio::test]
async fn a_scrub_records_damaged_and_missing_values_in_the_audit_log() {
    let app = TestApp::new().await;
    let session = app.session_with_surfaces().await;
    let mut last = Scrubbed::default();
    app.state.service.scrub(&mut last).await.unwrap();
    let notes = || -> Vec<Value> {
        let audit = std::fs::read_dir(app.directory().join("audit")).unwrap().next().unwrap().unwrap();
        let text = std::fs::read_to_string(audit.path()).unwrap();
        let entries = text.lines().map(|l| serde_json::from_str::<Value>(l).unwrap()["entry"].clone());
        entries.filter(|entry| entry["what"].as_str().unwrap().starts_with("a stored value")).collect()
    };
    assert_eq!(notes(), [] as [Value; 0]);
    let files = values(app.directory());
    flip_a_bit(&files[0]);
    std::fs::remove_file(&files[1]).unwrap();
    app.state.service.scrub(&mut last).await.unwrap();
    let mut found: Vec<_> = notes().iter().map(|n| n["what"].as_str().unwrap().to_owned()).collect();
    found.sort();
    assert_eq!(found, ["a stored value is damaged", "a stored value is missing"]);
    assert!(notes().iter().all(|n| session.ends_with(n["id"].as_str().unwrap().split('/').next().unwrap())));
}
