use std::io::{BufRead, BufReader};
use std::time::Instant;

use serde_json::{Value, json};
use ureq::Agent;

use super::latencies::{Kind, Latencies};
use crate::error::BenchError;

/// Longest answer that is read, bytes.
const MAX_ANSWER: u64 = 1 << 30;

/// A client with its own connections and its own record of latencies.
#[derive(Debug)]
pub(super) struct Client {
    agent: Agent,
    base: String,
    pub(super) latencies: Latencies,
}

impl Client {
    pub(super) fn new(base: &str) -> Self {
        let agent = Agent::new_with_config(Agent::config_builder().http_status_as_error(false).build());
        Self { agent, base: base.to_owned(), latencies: Latencies::default() }
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }

    /// Sends a request, reads the whole answer and records the latency; a status other than 2xx is an error.
    fn timed(
        &mut self,
        kind: Kind,
        ask: impl FnOnce(&Agent) -> Result<ureq::http::Response<ureq::Body>, ureq::Error>,
    ) -> Result<Value, BenchError> {
        let begun = Instant::now();
        let read = ask(&self.agent).and_then(|mut answer| {
            let body = answer.body_mut().with_config().limit(MAX_ANSWER).read_to_vec()?;
            Ok((answer.status(), body))
        });
        let (status, body) = match read {
            Ok(read) => read,
            Err(error) => return Err(self.latencies.error(kind, &error)),
        };
        if !status.is_success() {
            return Err(self.latencies.error(kind, &format!("{status}: {}", String::from_utf8_lossy(&body))));
        }
        self.latencies.add(kind, begun.elapsed());
        Ok(serde_json::from_slice(&body).unwrap_or_default())
    }

    pub(super) fn get(&mut self, kind: Kind, path: &str) -> Result<Value, BenchError> {
        let url = self.url(path);
        self.timed(kind, |agent| agent.get(url).call())
    }

    pub(super) fn post(&mut self, kind: Kind, path: &str, body: &Value) -> Result<Value, BenchError> {
        let url = self.url(path);
        self.timed(kind, |agent| agent.post(url).send_json(body))
    }

    pub(super) fn upload(&mut self, kind: Kind, path: &str, bytes: &[u8]) -> Result<Value, BenchError> {
        let url = self.url(path);
        self.timed(kind, |agent| agent.put(url).header("content-type", "application/octet-stream").send(bytes))
    }

    /// Creates a session and returns its path.
    pub(super) fn session(&mut self) -> Result<String, BenchError> {
        let made = self.post(Kind::Other, "/v1/sessions", &json!({}))?;
        Ok(format!("/v1/sessions/{}", made["id"].as_str().unwrap_or_default()))
    }

    /// Posts a solve and returns the path of its job.
    pub(super) fn solve(&mut self, session: &str, body: &Value) -> Result<String, BenchError> {
        let job = self.post(Kind::Other, &format!("{session}/jobs"), body)?;
        Ok(format!("/v1/jobs/{}", job["id"].as_str().unwrap_or_default()))
    }

    /// Waits for the end of a job and returns its status.
    pub(super) fn finish(&mut self, job: &str) -> Result<String, BenchError> {
        loop {
            let view = self.get(Kind::Other, &format!("{job}?wait_s=20"))?;
            let status = view["status"].as_str().unwrap_or_default();
            if !["accepted", "running", "interrupted"].contains(&status) {
                return Ok(status.to_owned());
            }
        }
    }

    /// Follows a job to its end and returns the number of events; a stream that ends earlier is an error.
    pub(super) fn follow(&mut self, job: &str) -> Result<usize, BenchError> {
        let begun = Instant::now();
        let request = self.agent.get(self.url(&format!("{job}/events"))).header("accept", "text/event-stream");
        let answer = request.call().map_err(|e| self.latencies.error(Kind::Stream, &e))?;
        if answer.status() != 200 {
            return Err(self.latencies.error(Kind::Stream, &answer.status()));
        }
        let mut events = 0;
        for line in BufReader::new(answer.into_body().into_reader()).lines() {
            let line = line.map_err(|e| self.latencies.error(Kind::Stream, &e))?;
            if let Some(event) = line.strip_prefix("event: ") {
                if events == 0 {
                    self.latencies.add(Kind::Stream, begun.elapsed());
                }
                events += 1;
                if event == "end" {
                    return Ok(events);
                }
            }
        }
        Err(self.latencies.error(Kind::Stream, &"the stream ended before the job"))
    }
}
