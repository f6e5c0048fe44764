//! The real binary: where it listens, how it stops.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A served directory; the process is killed when this is dropped.
struct Server {
    child: Child,
    url: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

fn serve(data: &Path, listen: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
    command.arg("serve").args(["--listen", listen, "--threads", "1", "--data"]).arg(data);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn start(data: &Path) -> Server {
    let mut child = serve(data, "127.0.0.1:0").spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    // Nobody reads the log; it must not fill the pipe.
    let mut log = child.stderr.take().unwrap();
    std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
    let url = line.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("found {line:?}")).to_owned();
    Server { child, url }
}

fn get(url: &str) -> serde_json::Value {
    ureq::get(url).call().unwrap().body_mut().read_json().unwrap()
}

#[test]
fn a_killed_service_has_everything_when_it_starts_again() {
    let directory = tempfile::tempdir().unwrap();
    let server = start(directory.path());
    let body = serde_json::json!({"label": "kept"});
    let mut made = ureq::post(format!("{}/v1/sessions", server.url)).send_json(body).unwrap();
    let session: serde_json::Value = made.body_mut().read_json().unwrap();
    let path = format!("/v1/sessions/{}", session["id"].as_str().unwrap());
    ureq::put(format!("{}{path}/skin", server.url)).send(crate::shapes::skin()).unwrap();
    let before = get(&format!("{}{path}", server.url));
    drop(server);
    let server = start(directory.path());
    assert_eq!(get(&format!("{}{path}", server.url)), before);
}

#[cfg(unix)]
#[test]
fn a_terminated_service_stops_in_good_order() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = start(directory.path());
    let id = server.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert!(server.child.wait().unwrap().success());
}

#[test]
fn an_address_beyond_loopback_is_refused_with_the_reason() {
    let directory = tempfile::tempdir().unwrap();
    let output = serve(directory.path(), "0.0.0.0:0").output().unwrap();
    assert!(!output.status.success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(message.contains("no authentication") && message.contains("0.0.0.0:0"), "{message}");
}

#[test]
fn the_description_is_printed() {
    let output = Command::new(env!("CARGO_BIN_EXE_prosopon")).arg("openapi").output().unwrap();
    assert!(output.stdout == include_bytes!("../../api/openapi.json"));
}
