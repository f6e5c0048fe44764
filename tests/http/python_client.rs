//! The main job over a real socket, driven by the Python client.
//!
//! The service runs on the runtime's workers while this thread waits for Python.

use std::process::{Command, Stdio};
use std::sync::Arc;

use prosopon_service::config::ServeConfig;
use prosopon_service::serve;

use crate::support::shapes::{cube, skin, skull, stl};
use crate::support::stand_in::StandIn;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_example_of_the_python_client_solves_a_plan() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let config = ServeConfig::new(at("data"));
    let running = serve::start_with(config, Arc::new(StandIn::default())).await.unwrap();
    assert_eq!(std::fs::read_to_string(at("data/listen")).unwrap().trim(), running.url());
    std::fs::write(at("skin.stl"), skin()).unwrap();
    std::fs::write(at("skull.stl"), skull()).unwrap();
    std::fs::write(at("target.stl"), stl(&cube([0.0, -6.0, 0.0], 100.0))).unwrap();
    let landmarks = r#"{"points": {"ans": [0, -60, 0]}, "midline_x_mm": 0, "occlusal_plane_z_mm": -30,
        "le_fort_1_plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 1]}}"#;
    std::fs::write(at("landmarks.json"), landmarks).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/api/clients/python/examples/main_job.py");
    let output = Command::new("python3")
        .arg("-B")
        .args([script, &running.url(), "--steps", "3"])
        .arg("--skin")
        .arg(at("skin.stl"))
        .arg("--skull")
        .arg(at("skull.stl"))
        .arg("--target")
        .arg(at("target.stl"))
        .arg("--landmarks")
        .arg(at("landmarks.json"))
        .arg("--out")
        .arg(at("out"))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}\n{err}");
    assert!(out.contains("step 3 of 3") && out.contains("upper_lip"), "{out}");
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(at("out/report.json")).unwrap()).unwrap();
    assert_eq!(report["regions"]["upper_lip"]["forward_mm"], 6.0);
    assert_eq!(report["error"]["reference"], "target");
    for k in 1..=3 {
        assert!(std::fs::read(at(&format!("out/skin_{k}.glb"))).unwrap().starts_with(b"glTF"));
        assert!(std::fs::read(at(&format!("out/skin_{k}.ply"))).unwrap().starts_with(b"ply"));
    }
    running.shut_down().await;
}

/// A client that sends its whole upload before it reads still receives the refusal.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_python_client_receives_the_refusal_of_an_upload() {
    let directory = tempfile::tempdir().unwrap();
    let mut config = ServeConfig::new(directory.path().join("data"));
    config.limits.max_surface_bytes = 1 << 20;
    let running = serve::start_with(config, Arc::new(StandIn::default())).await.unwrap();
    let large = directory.path().join("large.stl");
    std::fs::File::create(&large).unwrap().set_len(64 << 20).unwrap();
    let script = format!(
        "import sys; sys.path.insert(0, {:?})\nfrom prosopon import Client, Problem\nc = Client({:?})\n\
         s = c.create_session()['id']\ntry: c.put_surface(s, 'skin', {:?})\n\
         except Problem as p: print(p.status, p.kind)",
        concat!(env!("CARGO_MANIFEST_DIR"), "/api/clients/python"),
        running.url(),
        large
    );
    let output = Command::new("python3").args(["-B", "-c", &script]).output().unwrap();
    let out = String::from_utf8_lossy(&output.stdout);
    assert_eq!(out.trim(), "413 too-large", "{}", String::from_utf8_lossy(&output.stderr));
    running.shut_down().await;
}
