//! User errors over a real socket with the real numerics: each gives a problem that names the error, and the service keeps
//! running.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde_json::json;

use crate::support::binary::Server;
use crate::support::shapes::{cube, nifti, ply_with, skin, skull};

const GIGABYTE: u64 = 1 << 30;

#[test]
fn files_that_cannot_be_used() {
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

#[test]
fn cuts_paths_and_jobs_that_do_not_fit() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let empty = server.session();
    let no_plan = json!({ "plan": "00000000-0000-0000-0000-000000000000" });
    server.post(&format!("{empty}/jobs"), &no_plan).refused(409, "missing-input", "skin and skull");

    let session = server.session_with_field();
    server.post(&format!("{session}/jobs"), &no_plan).refused(422, "invalid-request", "plan");

    let far = json!({ "cuts": [{ "plane": { "point_mm": [0, 0, 900], "normal": [0, 0, 1] } }] });
    let problem = server.post(&format!("{session}/osteotomies"), &far).refused(422, "cut-misses-bone", "mm");
    assert!(problem["distance_mm"].as_f64().unwrap() > 100.0, "{problem}");
    assert_eq!(problem["errors"][0]["pointer"], "/cuts/0");

    let (osteotomy, jaw) = server.cut(&session);
    let plan = |times: [f64; 2]| {
        let waypoints = times.map(|t| json!({ "t": t, "translation_mm": [0, -t, 0] }));
        json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] })
    };
    for times in [[0.7, 0.3], [0.5, 0.5]] {
        let problem = server.post(&format!("{session}/plans"), &plan(times)).json();
        let pointer = problem["errors"][0]["pointer"].as_str().unwrap_or_default();
        assert!(problem["status"] == 422 && pointer.starts_with("/paths/0/waypoints/1"), "{problem}");
    }
    server.post(&format!("{session}/plans"), &plan([0.3, 1.0])).ok();
}

#[test]
fn three_gigabytes_cost_neither_memory_nor_disk() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &["--max-surface-mb", "256", "--max-ct-mb", "256"]);
    let session = server.session();
    server.upload(&format!("{session}/skin"), &skin()).ok();
    let (files, memory) = (bytes_below(directory.path()), peak_memory(&server));
    // Zeros are not a CT and would be refused at once; this file is a CT with 432 MB of voxels.
    let mut header = nifti()[..352].to_vec();
    for at in [42, 44, 46] {
        header[at..at + 2].copy_from_slice(&600i16.to_le_bytes());
    }
    for (part, beginning) in [("skin", Vec::new()), ("ct", header)] {
        for chunked in [false, true] {
            let answer = upload_endlessly(&server, &format!("{session}/{part}"), &beginning, chunked);
            assert!(answer.starts_with("HTTP/1.1 413 ") && answer.contains("application/problem+json"), "{answer}");
            assert!(answer.contains("/problems/too-large") && answer.contains("268435456"), "{answer}");
        }
    }
    assert!(peak_memory(&server) < memory + 100 * (1 << 20), "{memory} then {}", peak_memory(&server));
    // The journal and the shared memory of the database may have grown.
    assert!(bytes_below(&directory.path().join("blobs")) < 10_000 && bytes_below(directory.path()) < files + (1 << 20));
    assert_eq!(server.get("/readyz").status, 200);
    server.upload(&format!("{session}/skin"), &skin()).ok();
}

/// Sends `beginning` and then zeros, up to three gigabytes, until the service answers; returns the answer.
fn upload_endlessly(server: &Server, path: &str, beginning: &[u8], chunked: bool) -> String {
    let mut socket = TcpStream::connect(server.address()).unwrap();
    socket.set_write_timeout(Some(Duration::from_secs(60))).unwrap();
    let framing =
        if chunked { "Transfer-Encoding: chunked".to_owned() } else { format!("Content-Length: {}", 3 * GIGABYTE) };
    let head = format!("PUT {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{framing}\r\n\r\n");
    socket.write_all(head.as_bytes()).unwrap();
    let answered = AtomicBool::new(false);
    let mut reader = socket.try_clone().unwrap();
    std::thread::scope(|scope| {
        let answer = scope.spawn(|| {
            reader.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            let (mut answer, mut piece) = (String::new(), [0; 4096]);
            // Read to the end of the problem: the connection may stay open while the service discards the rest.
            while !answer.ends_with('}') {
                match reader.read(&mut piece) {
                    Ok(n) if n > 0 => answer.push_str(&String::from_utf8_lossy(&piece[..n])),
                    _ => break,
                }
            }
            answered.store(true, Ordering::SeqCst);
            answer
        });
        let mut next = beginning.to_vec();
        next.resize(1 << 20, 0);
        let mut sent = 0;
        while sent < 3 * GIGABYTE && !answered.load(Ordering::SeqCst) {
            let size = format!("{:x}\r\n", next.len());
            let pieces: &[&[u8]] = if chunked { &[size.as_bytes(), &next, b"\r\n"] } else { &[&next] };
            if pieces.iter().any(|piece| socket.write_all(piece).is_err()) {
                break;
            }
            sent += next.len() as u64;
            next.fill(0);
        }
        answer.join().unwrap()
    })
}

fn bytes_below(path: &Path) -> u64 {
    let below =
        |e: std::fs::DirEntry| if e.path().is_dir() { bytes_below(&e.path()) } else { e.metadata().unwrap().len() };
    std::fs::read_dir(path).map(|d| d.map(|e| below(e.unwrap())).sum()).unwrap_or(0)
}

/// Peak resident memory, bytes; 0 where the system does not report it.
fn peak_memory(server: &Server) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", server.child.id())).unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or_default();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap_or(0) * 1024
}
