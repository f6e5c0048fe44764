//! Jobs cancelled at random moments, on materials, meshes and plans with which nothing converges: each lets go of its threads.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::binary::{Reply, Server};
use prosopon_formats::export;
use prosopon_geometry::{Point, TriMesh};

/// Number of cancellations: 200 with `SLOW_TESTS`, which takes ten minutes.
fn cancellations() -> usize {
    if std::env::var_os("SLOW_TESTS").is_some() { 200 } else { 10 }
}

/// Time after which threads that a cancelled job still holds count as lost. How fast they are let go is printed, not tested.
const LOST_AFTER: Duration = Duration::from_secs(30);

/// Numbers from 0 to 1, the same in each run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Yeoh's energy falls without bound for these constants: each iterate is farther away than the last.
fn falling(c2_mpa: f64) -> Value {
    json!({ "fat": { "law": "yeoh", "c1_mpa": 0.001, "c2_mpa": c2_mpa, "c3_mpa": 0, "poisson": 0.45 } })
}

struct Scene<'a> {
    server: &'a Server,
    session: String,
    osteotomy: Value,
    jaw: Value,
}

impl<'a> Scene<'a> {
    /// The phantom with its jaw cut and a coarse mesh.
    fn new(server: &'a Server) -> Self {
        let session = server.session_with_field();
        let (osteotomy, jaw) = server.cut(&session);
        server.finish(&server.post(&format!("{session}/mesh"), &json!({ "osteotomy": osteotomy, "edge_mm": 8.0 })));
        Self { server, session, osteotomy, jaw }
    }

    fn solve(&self, motion: Value, more: &Value) -> Reply {
        let mut way = json!({ "t": 1 });
        merge(&mut way, motion);
        let plan = json!({ "osteotomy": self.osteotomy, "paths": [{ "segment": self.jaw, "waypoints": [way] }] });
        let mut request = json!({ "plan": plan, "steps": 2 });
        merge(&mut request, more.clone());
        self.server.post(&format!("{}/jobs", self.session), &request)
    }

    /// A job of one of six kinds, none of which can be answered from memory.
    fn begin(&self, kind: usize, random: &mut Random) -> Reply {
        let forward = |mm: f64| json!({ "translation_mm": [0, -mm, 0] });
        match kind {
            0 => self.solve(forward(4.0), &json!({ "materials": falling(-10.0 * random.next()) })),
            1 => self.solve(
                forward(4.0),
                &json!({ "materials": falling(-0.2 * random.next()), "unstable_material": "stabilise" }),
            ),
            // Deep into the lower jaw.
            2 => self.solve(json!({ "translation_mm": [0, 0, -20.0 - 10.0 * random.next()] }), &json!({})),
            3 => self.solve(
                json!({ "rotation": { "axis_angle": { "axis": [1, 0, 0], "angle_deg": 60.0 + 60.0 * random.next() } } }),
                &json!({ "locking": "patched" }),
            ),
            4 => {
                let edge_mm = 5.0 + 2.0 * random.next();
                let mesh = json!({ "osteotomy": self.osteotomy, "edge_mm": edge_mm });
                self.server.post(&format!("{}/mesh", self.session), &mesh)
            }
            _ => {
                let fine = json!({ "spacing_mm": 0.6 + 0.2 * random.next(), "envelope_spacing_mm": 1.0, "envelope_closing_mm": 4.0 });
                let session = self.server.session_with_surfaces();
                self.server.put_json(&format!("{session}/field/settings"), &fine).ok();
                self.server.post(&format!("{session}/field"), &json!({}))
            }
        }
    }
}

fn merge(into: &mut Value, from: Value) {
    if let (Some(into), Value::Object(from)) = (into.as_object_mut(), from) {
        into.extend(from);
    }
}

/// Value of a metric without labels, or the sum over its labels.
fn metric(server: &Server, name: &str) -> f64 {
    let text = String::from_utf8(server.get("/metrics").body).unwrap();
    let lines = text.lines().filter(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with([' ', '{'])));
    lines.map(|line| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap()).sum()
}

#[test]
#[allow(clippy::disallowed_methods, reason = "the moments of cancellation are waited for")]
fn cancelled_work_lets_go_of_its_threads_wherever_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let scene = Scene::new(&server);
    let mut random = Random(29);
    let mut times: Vec<(f64, usize)> = Vec::new();
    for round in 0..cancellations() {
        let kind = round % 6;
        let job = scene.begin(kind, &mut random).ok()["id"].as_str().unwrap().to_owned();
        std::thread::sleep(Duration::from_secs_f64(3.0 * random.next()));
        let begin = Instant::now();
        server.post(&format!("/v1/jobs/{job}/cancel"), &json!({}));
        while metric(&server, "prosopon_jobs_running") > 0.0 {
            assert!(begin.elapsed() < LOST_AFTER, "round {round}: kind {kind} still holds its threads");
            std::thread::sleep(Duration::from_millis(10));
        }
        times.push((begin.elapsed().as_secs_f64(), kind));
        let status = server.get(&format!("/v1/jobs/{job}")).ok()["status"].clone();
        assert!(["cancelled", "succeeded", "failed"].iter().any(|s| status == *s), "{status}");
    }
    assert_eq!(metric(&server, "prosopon_jobs_ignoring_stop"), 0.0);
    assert_eq!(server.get("/readyz").status, 200);
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!(
        "{} cancellations: threads free after p50 {:.3} s, p95 {:.3} s, p100 {:.3} s (kind {})",
        times.len(),
        at(0.5).0,
        at(0.95).0,
        at(1.0).0,
        at(1.0).1
    );
}

/// Legal constants with which the energy has no minimum: the job ends by itself, near its limit at the latest, and the worker
/// goes on.
#[test]
fn a_material_without_equilibrium_ends_its_own_job_only() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let scene = Scene::new(&server);
    for c2_mpa in [-10.0, -0.1] {
        let forward = json!({ "translation_mm": [0, -4, 0] });
        let limited = json!({ "materials": falling(c2_mpa), "max_wall_s": 60 });
        let ended = server.end(&scene.solve(forward.clone(), &limited));
        assert_eq!(ended["status"], "failed", "{ended}");
        let kind = ended["problem"]["type"].as_str().unwrap();
        assert!(kind.starts_with("/problems/solver-"), "it ends before its limit: {ended}");
    }
    let usual = scene.solve(json!({ "translation_mm": [0, -4, 0] }), &json!({}));
    assert_eq!(server.finish(&usual)["status"], "succeeded");
}

/// Three hundred triangles at random places are no skin: their mesh is refused after bounded work.
#[test]
fn a_skin_of_random_triangles_ends_with_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::start(directory.path(), &[]);
    let session = server.session_with_field();
    let mut random = Random(7);
    let mut point =
        || Point::new(200.0 * random.next() - 100.0, 200.0 * random.next() - 100.0, 200.0 * random.next() - 100.0);
    let corners: Vec<Point> = (0..900).map(|_| point()).collect();
    let triangles = (0..300).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let skin = TriMesh::new(corners, triangles).unwrap();
    let taken = server.upload(&format!("{session}/skin"), &export::stl(&skin));
    if taken.status != 200 {
        taken.refused(422, "surface-not-usable", "");
        return;
    }
    let (osteotomy, _) = server.cut(&session);
    let mesh = json!({ "osteotomy": osteotomy, "edge_mm": 8.0, "max_wall_s": 120 });
    let ended = server.end(&server.post(&format!("{session}/mesh"), &mesh));
    assert_eq!(
        (&ended["status"], &ended["problem"]["type"]),
        (&json!("failed"), &json!("/problems/mesh-not-usable")),
        "{ended}"
    );
}
