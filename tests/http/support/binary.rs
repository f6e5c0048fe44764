//! The real binary with the real numerics, on a phantom head coarse enough for jobs of a few seconds.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use prosopon_formats::export;
use prosopon_planning::phantom;
use serde_json::{Value, json};
use ureq::http::Response;
use ureq::{Agent, Body};

/// A running service; its process is killed on drop.
pub(crate) struct Server {
    pub(crate) child: Child,
    pub(crate) url: String,
    agent: Agent,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

pub(crate) fn serve(data: &Path, listen: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
    command.arg("serve").args(["--listen", listen, "--threads", "1", "--data"]).arg(data);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A completely read answer.
#[derive(Debug)]
pub(crate) struct Reply {
    pub(crate) status: u16,
    media_type: String,
    pub(crate) body: Vec<u8>,
}

impl Reply {
    fn of(mut response: Response<Body>) -> Self {
        let media_type = response.headers().get("content-type").map(|t| t.to_str().unwrap().to_owned());
        let body = response.body_mut().with_config().limit(1 << 30).read_to_vec().unwrap();
        Self { status: response.status().as_u16(), media_type: media_type.unwrap_or_default(), body }
    }

    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("no JSON in an answer {}", self.status))
    }

    #[track_caller]
    pub(crate) fn ok(&self) -> Value {
        assert!((200..300).contains(&self.status), "{} {}", self.status, String::from_utf8_lossy(&self.body));
        self.json()
    }

    /// The answer must be a problem of this kind whose detail contains these words.
    #[track_caller]
    pub(crate) fn refused(&self, status: u16, kind: &str, words: &str) -> Value {
        let document = self.json();
        assert_eq!((self.status, self.media_type.as_str()), (status, "application/problem+json"), "{document}");
        assert_eq!((&document["type"], &document["status"]), (&json!(format!("/problems/{kind}")), &json!(status)));
        assert!(document["detail"].as_str().is_some_and(|d| d.contains(words)), "{document}");
        document
    }
}

/// An open stream of events.
pub(crate) struct EventStream {
    lines: BufReader<Box<dyn std::io::Read>>,
}

impl EventStream {
    pub(crate) fn next_event(&mut self) -> Value {
        let mut line = String::new();
        assert!(self.lines.read_line(&mut line).unwrap() > 0, "the stream ended");
        serde_json::from_str(&line).unwrap()
    }
}

impl Server {
    pub(crate) fn start(data: &Path, more: &[&str]) -> Self {
        let mut command = serve(data, "127.0.0.1:0");
        command.args(more);
        Self::spawn(command)
    }

    pub(crate) fn spawn(mut command: Command) -> Self {
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        // The test does not read the log, so the log must not fill the pipe.
        let mut log = child.stderr.take().unwrap();
        std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
        let url = line.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("found {line:?}")).to_owned();
        let agent = Agent::new_with_config(Agent::config_builder().http_status_as_error(false).build());
        Self { child, url, agent }
    }

    /// How the process ended by itself; `None` when it still runs after `limit`.
    #[allow(clippy::disallowed_methods, reason = "the end of a process can only be polled")]
    pub(crate) fn end_within(mut self, limit: Duration) -> Option<ExitStatus> {
        let begin = Instant::now();
        loop {
            match self.child.try_wait().unwrap() {
                None if begin.elapsed() < limit => std::thread::sleep(Duration::from_millis(50)),
                ended => return ended,
            }
        }
    }

    pub(crate) fn get(&self, path: &str) -> Reply {
        Reply::of(self.agent.get(format!("{}{path}", self.url)).call().unwrap())
    }

    pub(crate) fn get_as(&self, token: &str, path: &str) -> Reply {
        let request = self.agent.get(format!("{}{path}", self.url)).header("authorization", format!("Bearer {token}"));
        Reply::of(request.call().unwrap())
    }

    pub(crate) fn post(&self, path: &str, body: &Value) -> Reply {
        Reply::of(self.agent.post(format!("{}{path}", self.url)).send_json(body).unwrap())
    }

    pub(crate) fn delete(&self, path: &str) -> Reply {
        Reply::of(self.agent.delete(format!("{}{path}", self.url)).call().unwrap())
    }

    pub(crate) fn put_json(&self, path: &str, body: &Value) -> Reply {
        Reply::of(self.agent.put(format!("{}{path}", self.url)).send_json(body).unwrap())
    }

    pub(crate) fn upload(&self, path: &str, bytes: &[u8]) -> Reply {
        Reply::of(self.agent.put(format!("{}{path}", self.url)).send(bytes).unwrap())
    }

    /// Events of a job that has ended.
    pub(crate) fn get_lines(&self, path: &str) -> Vec<Value> {
        let request = self.agent.get(format!("{}{path}", self.url)).header("accept", "application/x-ndjson");
        let body = Reply::of(request.call().unwrap()).body;
        String::from_utf8(body).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// Events of a job as they arrive.
    pub(crate) fn stream(&self, path: &str) -> EventStream {
        self.stream_after(path, 0)
    }

    /// Events of a job after the event `id`, as they arrive.
    pub(crate) fn stream_after(&self, path: &str, id: u64) -> EventStream {
        let request = self.agent.get(format!("{}{path}", self.url)).header("accept", "application/x-ndjson");
        let request = request.header("last-event-id", id.to_string());
        EventStream { lines: BufReader::new(Box::new(request.call().unwrap().into_body().into_reader())) }
    }

    /// `127.0.0.1:PORT`.
    pub(crate) fn address(&self) -> &str {
        self.url.strip_prefix("http://").unwrap()
    }

    // ---- steps to a job ----

    pub(crate) fn session(&self) -> String {
        format!("/v1/sessions/{}", self.post("/v1/sessions", &json!({})).ok()["id"].as_str().unwrap())
    }

    /// Waits for the end of an accepted job, which must succeed.
    pub(crate) fn finish(&self, accepted: &Reply) -> Value {
        let view = self.end(accepted);
        assert_eq!(view["status"], "succeeded", "{view}");
        view
    }

    /// The view of the job at its end, with any outcome.
    pub(crate) fn end(&self, accepted: &Reply) -> Value {
        let job = accepted.ok();
        loop {
            let view = self.get(&format!("/v1/jobs/{}?wait_s=30", job["id"].as_str().unwrap())).ok();
            if !matches!(view["status"].as_str().unwrap(), "accepted" | "running" | "interrupted") {
                return view;
            }
        }
    }

    /// A session of the phantom with its landmarks.
    pub(crate) fn session_with_surfaces(&self) -> String {
        let session = self.session();
        let head = phantom::head();
        for (part, solid) in [("skin", &head.skin), ("skull", &head.skull)] {
            let surface = phantom::surface_of(solid.as_ref(), &head.bounds(), 3.0).unwrap();
            self.upload(&format!("{session}/{part}"), &export::stl(&surface)).ok();
        }
        let (point, normal) = head.landmarks.le_fort_1_plane;
        let points = head.landmarks.points.iter().map(|(n, p)| (n.clone(), json!([p.x, p.y, p.z])));
        let landmarks = json!({
            "points": points.collect::<serde_json::Map<_, _>>(),
            "midline_x_mm": head.landmarks.midline_x_mm,
            "occlusal_plane_z_mm": head.landmarks.occlusal_plane_z_mm,
            "le_fort_1_plane": { "point_mm": [point.x, point.y, point.z], "normal": [normal.x, normal.y, normal.z] },
        });
        self.put_json(&format!("{session}/landmarks"), &landmarks).ok();
        session
    }

    /// A session of the phantom with its fields.
    pub(crate) fn session_with_field(&self) -> String {
        let session = self.session_with_surfaces();
        let coarse = json!({ "spacing_mm": 2.0, "envelope_spacing_mm": 2.0, "envelope_closing_mm": 4.0 });
        self.put_json(&format!("{session}/field/settings"), &coarse).ok();
        self.finish(&self.post(&format!("{session}/field"), &json!({})));
        session
    }

    /// Cuts the bone; returns the osteotomy and the segment of the upper jaw.
    pub(crate) fn cut(&self, session: &str) -> (Value, Value) {
        let cut = json!({ "template": { "name": "le_fort_1" } });
        let osteotomy = self.post(&format!("{session}/osteotomies"), &cut).ok();
        let segments = osteotomy["segments"].as_array().unwrap();
        let is_jaw = |s: &&Value| s["id"] != 0 && s["bounded_by"].as_array().unwrap().contains(&json!(0));
        let jaw = segments.iter().find(is_jaw).unwrap()["id"].clone();
        (osteotomy["id"].clone(), jaw)
    }
}
