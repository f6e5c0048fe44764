//! Groups of processes and their jobs.

use std::process::{Command, Stdio};

use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::runtime::Runtime;

use crate::binary::Server;
use crate::engines::{Bucket, Cluster};

/// Database server and bucket that all groups share.
pub(crate) struct Site<'s> {
    pub(crate) runtime: &'s Runtime,
    pub(crate) cluster: &'s Cluster,
    pub(crate) bucket: &'s Bucket,
}

/// Processes on one store.
pub(crate) struct Group {
    pub(crate) api: Server,
    pub(crate) workers: Vec<Server>,
    database: String,
    directories: Vec<TempDir>,
}

impl Site<'_> {
    /// One process with its own disk that computes `parallel` jobs at the same time.
    pub(crate) fn embedded(&self, parallel: usize) -> Group {
        let directory = tempfile::tempdir().unwrap();
        let mut command = command("serve", &directory);
        command.env("PROSOPON_PARALLEL_JOBS", parallel.to_string());
        Group {
            api: Server::spawn(command),
            workers: Vec::new(),
            database: String::new(),
            directories: vec![directory],
        }
    }

    /// An API process and `workers` worker processes on a new database.
    pub(crate) fn shared(&self, workers: usize, environment: &[(&str, &str)]) -> Group {
        let database = self.runtime.block_on(self.cluster.fresh_database());
        let directory = tempfile::tempdir().unwrap();
        let api = self.spawn("serve --no-worker", &directory, &database, environment);
        let mut group = Group { api, workers: Vec::new(), database, directories: vec![directory] };
        for _ in 0..workers {
            group.add_worker(self, environment);
        }
        group
    }

    fn spawn(&self, role: &str, directory: &TempDir, database: &str, environment: &[(&str, &str)]) -> Server {
        let mut command = command(role, directory);
        // A prefix in the bucket belongs to one database.
        let (_, name) = database.rsplit_once('/').unwrap();
        command.env("PROSOPON_DATABASE", database).env("PROSOPON_BLOBS", format!("{}/{name}", self.bucket.url()));
        command.envs(self.bucket.environment()).envs(environment.iter().copied());
        Server::spawn(command)
    }
}

impl Group {
    pub(crate) fn add_worker(&mut self, site: &Site, environment: &[(&str, &str)]) {
        let directory = tempfile::tempdir().unwrap();
        self.workers.push(site.spawn("worker", &directory, &self.database, environment));
        self.directories.push(directory);
    }
}

fn command(role: &str, directory: &TempDir) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_prosopon"));
    command.args(role.split(' ')).args(["--listen", "127.0.0.1:0", "--threads", "1", "--data"]).arg(directory.path());
    command.env("PROSOPON_MAX_WAITING", "256").env("PROSOPON_MAX_WAITING_TENANT", "256");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Different plans on the phantom and their jobs.
pub(crate) struct Solves<'s> {
    server: &'s Server,
    /// Session, osteotomy, upper jaw.
    sessions: Vec<(String, Value, Value)>,
    model: &'static str,
    steps: u32,
    planned: usize,
}

impl<'s> Solves<'s> {
    pub(crate) fn new(server: &'s Server, sessions: usize, edge_mm: f64, model: &'static str, steps: u32) -> Self {
        let session = |_| {
            let session = server.session_with_field();
            let (osteotomy, jaw) = server.cut(&session);
            server.finish(
                &server.post(&format!("{session}/mesh"), &json!({ "osteotomy": osteotomy, "edge_mm": edge_mm })),
            );
            (session, osteotomy, jaw)
        };
        Self { server, sessions: (0..sessions).map(session).collect(), model, steps, planned: 0 }
    }

    /// Posts a job with a new plan; returns the path of the job.
    pub(crate) fn post(&mut self) -> String {
        let plan = self.plan();
        self.post_planned(&plan)
    }

    /// Creates a new plan; returns its session and id.
    pub(crate) fn plan(&mut self) -> (String, Value) {
        let (session, osteotomy, jaw) = &self.sessions[self.planned % self.sessions.len()];
        let waypoints = json!([{ "t": 1, "translation_mm": [0, -4.0 - 0.01 * self.planned as f64, 0] }]);
        self.planned += 1;
        let plan = json!({ "osteotomy": osteotomy, "paths": [{ "segment": jaw, "waypoints": waypoints }] });
        (session.clone(), self.server.post(&format!("{session}/plans"), &plan).ok()["id"].clone())
    }

    /// Posts a job for a plan; returns the path of the job.
    pub(crate) fn post_planned(&self, (session, plan): &(String, Value)) -> String {
        let job = json!({ "plan": plan, "model": self.model, "steps": self.steps });
        format!("/v1/jobs/{}", self.server.post(&format!("{session}/jobs"), &job).ok()["id"].as_str().unwrap())
    }

    /// Waits for the end of a job, which must succeed.
    pub(crate) fn finish(&self, job: &str) {
        loop {
            let view = self.server.get(&format!("{job}?wait_s=30")).ok();
            match view["status"].as_str().unwrap() {
                "succeeded" => return,
                "accepted" | "running" | "interrupted" => {}
                _ => panic!("{view}"),
            }
        }
    }
}

/// Busy time of all processors of the machine, s.
pub(crate) fn busy_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/stat").unwrap();
    let ticks: Vec<f64> = stat.lines().next().unwrap().split_whitespace().skip(1).map(|t| t.parse().unwrap()).collect();
    // user, nice, system and interrupts; 100 ticks per second.
    (ticks[0] + ticks[1] + ticks[2] + ticks[5] + ticks[6]) / 100.0
}
