//! Several processes of the real binary with one Postgres database and one bucket.

use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};
use tokio::runtime::Handle;

use crate::engines::Bucket;
use crate::support::binary::Server;

/// `serve`, `serve --no-worker` or `worker`, with leases of two seconds.
pub(crate) fn start(role: &str, data: &Path, database: &str, bucket: &Bucket) -> Server {
    let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
    command.args(role.split(' ')).args(["--listen", "127.0.0.1:0", "--threads", "1", "--data"]).arg(data);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).env("PROSOPON_LEASE_S", "2");
    // These tests kill more workers than the default number of attempts allows.
    command.env("PROSOPON_MAX_WAITING", "256").env("PROSOPON_MAX_ATTEMPTS", "3");
    command.env("PROSOPON_DATABASE", database).env("PROSOPON_BLOBS", bucket.url()).envs(bucket.environment());
    Server::spawn(command)
}

/// Waits for the end of a job, also while the service cannot return its status.
pub(crate) fn finished(server: &Server, job: &Value) -> Value {
    loop {
        let view = server.get(&format!("/v1/jobs/{}?wait_s=5", job["id"].as_str().unwrap())).json();
        match view["status"].as_str() {
            Some("accepted" | "running" | "interrupted") => {}
            None if view["type"] == "/problems/store-unavailable" || view["type"] == "/problems/store-refuses" => {}
            _ => return view,
        }
    }
}

/// A session with the demo's plan on the coarse phantom, and the body of a job that solves it.
pub(crate) fn planned(server: &Server) -> (String, Value) {
    let session = server.session_with_field();
    let (osteotomy, jaw) = server.cut(&session);
    let waypoints = json!([{ "t": 1, "translation_mm": [0, -6, -1.5] }]);
    let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
    let plan = server.post(&format!("{session}/plans"), &plan).ok()["id"].clone();
    let mesh = json!({ "osteotomy": osteotomy, "edge_mm": 8.0 });
    finished(server, &server.post(&format!("{session}/mesh"), &mesh).ok());
    (session, json!({ "plan": plan, "model": "mixed", "steps": 16 }))
}

/// Starts the demo's plan on the coarse phantom; returns the view of the job.
pub(crate) fn solve_demo_plan(server: &Server) -> Value {
    let (session, request) = planned(server);
    server.post(&format!("{session}/jobs"), &request).ok()
}

/// A separate connection of the test to the database.
pub(crate) struct Rows(sqlx::PgConnection);

impl Rows {
    pub(crate) fn open(database: &str) -> Self {
        let connecting = <sqlx::PgConnection as sqlx::Connection>::connect(database);
        Self(Handle::current().block_on(connecting).unwrap())
    }

    pub(crate) fn count(&mut self, query: &'static str) -> i64 {
        Handle::current().block_on(sqlx::query_scalar(query).fetch_one(&mut self.0)).unwrap()
    }

    pub(crate) fn text(&mut self, query: &'static str) -> String {
        Handle::current().block_on(sqlx::query_scalar(query).fetch_one(&mut self.0)).unwrap()
    }
}

pub(crate) fn signal(server: &Server, name: &str) {
    assert!(Command::new("kill").args([name, &server.child.id().to_string()]).status().unwrap().success());
}
