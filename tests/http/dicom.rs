use std::io::{Cursor, Write};
use std::path::Path;

use serde_json::json;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use crate::support::app::TestApp;
use crate::support::shapes::nifti;

const NAME: &str = "NAME^OF PATIENT";

fn text(file: &mut Vec<u8>, tag: [u16; 2], vr: &[u8; 2], value: &str) {
    let value = if value.len().is_multiple_of(2) { value.to_owned() } else { format!("{value} ") };
    element(file, tag, vr, value.as_bytes());
}

fn element(file: &mut Vec<u8>, tag: [u16; 2], vr: &[u8; 2], value: &[u8]) {
    tag.iter().for_each(|t| file.extend(t.to_le_bytes()));
    file.extend(vr);
    if vr == b"OW" {
        file.extend([0; 2]);
        file.extend((value.len() as u32).to_le_bytes());
    } else {
        file.extend((value.len() as u16).to_le_bytes());
    }
    file.extend(value);
}

/// A slice of 8 x 8 pixels, explicit little endian, with a patient's name.
fn slice(series: &str, k: usize, height_mm: f64) -> Vec<u8> {
    let mut file = vec![0; 128];
    file.extend(b"DICM");
    text(&mut file, [2, 0x10], b"UI", "1.2.840.10008.1.2.1\0");
    text(&mut file, [8, 0x60], b"CS", "CT");
    text(&mut file, [0x10, 0x10], b"PN", NAME);
    text(&mut file, [0x20, 0x0e], b"UI", series);
    text(&mut file, [0x20, 0x32], b"DS", &format!("0\\0\\{height_mm}"));
    text(&mut file, [0x20, 0x37], b"DS", "1\\0\\0\\0\\1\\0");
    for (at, value) in [(0x10, 8u16), (0x11, 8), (0x100, 16), (0x101, 16), (0x102, 15), (0x103, 1)] {
        if at == 0x100 {
            text(&mut file, [0x28, 0x30], b"DS", "10\\10");
        }
        element(&mut file, [0x28, at], b"US", &value.to_le_bytes());
    }
    let pixels: Vec<u8> = (0..64i16).flat_map(|i| (i * 20 + k as i16 - 1000).to_le_bytes()).collect();
    element(&mut file, [0x7fe0, 0x10], b"OW", &pixels);
    file
}

fn archive(files: &[Vec<u8>]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (number, file) in files.iter().enumerate() {
        archive.start_file(format!("{NAME}/{number}"), SimpleFileOptions::default()).unwrap();
        archive.write_all(file).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn stack(heights: &[f64]) -> Vec<Vec<u8>> {
    heights.iter().enumerate().map(|(k, z)| slice("1.2.3.4", k, *z)).collect()
}

/// Whether any file below `path` contains `word`.
fn holds(path: &Path, word: &[u8]) -> bool {
    if path.is_dir() {
        return std::fs::read_dir(path).unwrap().any(|e| holds(&e.unwrap().path(), word));
    }
    std::fs::read(path).unwrap().windows(word.len()).any(|w| w == word)
}

#[tokio::test]
async fn a_dicom_series_becomes_surfaces_and_nothing_of_the_patient_is_kept() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let mut files = stack(&[0.0, 4.0, 8.0, 12.0, 16.0]);
    files.extend((0..4).map(|k| slice("1.2.9", k, 4.0 * k as f64)));
    files.push(b"a note".to_vec());
    let job = app.finish(app.upload(&format!("{session}/ct"), archive(&files)).await).await;
    assert_eq!(job["status"], "succeeded");
    let warnings = job["warnings"].to_string();
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
async fn series_that_cannot_be_read_are_refused_by_the_upload() {
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
async fn notes_in_the_header_of_a_nifti_file_are_not_kept() {
    let app = TestApp::new().await;
    let session = app.session().await;
    let mut file = nifti();
    // The field `descrip`.
    file[148..148 + NAME.len()].copy_from_slice(NAME.as_bytes());
    let job = app.finish(app.upload(&format!("{session}/ct"), file).await).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    assert!(!holds(app.directory(), NAME.as_bytes()), "the note was stored");
}
