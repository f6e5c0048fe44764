use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use serde_json::Value;
use ureq::http::Response;
use ureq::{Agent, Body};

use super::DemoError;

/// Largest answer that the demo reads into memory, bytes.
const MAX_ANSWER: u64 = 1 << 30;

/// A blocking client of one service.
#[derive(Debug)]
pub(super) struct Client {
    agent: Agent,
    base: String,
}

impl Client {
    pub(super) fn new(base: String) -> Self {
        let agent = Agent::new_with_config(Agent::config_builder().http_status_as_error(false).build());
        Self { agent, base }
    }

    pub(super) fn get(&self, path: &str) -> Result<Value, DemoError> {
        let response = self.agent.get(self.url(path)).call()?;
        json("GET", path, response)
    }

    pub(super) fn post(&self, path: &str, body: &Value) -> Result<Value, DemoError> {
        let response = self.agent.post(self.url(path)).send_json(body)?;
        json("POST", path, response)
    }

    pub(super) fn put(&self, path: &str, body: &Value) -> Result<Value, DemoError> {
        let response = self.agent.put(self.url(path)).send_json(body)?;
        json("PUT", path, response)
    }

    /// Streams a file as the body of a PUT.
    pub(super) fn upload(&self, path: &str, file: &Path) -> Result<Value, DemoError> {
        let opened = File::open(file).map_err(|e| DemoError::file(file, e))?;
        let request = self.agent.put(self.url(path)).header("content-type", "application/octet-stream");
        json("PUT", path, request.send(opened)?)
    }

    /// Sends bytes as the body of a PUT.
    pub(super) fn upload_bytes(&self, path: &str, bytes: &[u8]) -> Result<Value, DemoError> {
        let request = self.agent.put(self.url(path)).header("content-type", "application/octet-stream");
        json("PUT", path, request.send(bytes)?)
    }

    pub(super) fn download(&self, path: &str) -> Result<Vec<u8>, DemoError> {
        let mut response = refuse_problem("GET", path, self.agent.get(self.url(path)).call()?)?;
        Ok(response.body_mut().with_config().limit(MAX_ANSWER).read_to_vec()?)
    }

    /// Reads a job's events after number `last` as they arrive, and updates `last`.
    ///
    /// `on_event` receives the name and data of each event and returns whether to continue.
    pub(super) fn events(
        &self,
        job: &str,
        last: &mut u64,
        on_event: &mut dyn FnMut(&str, &Value) -> Result<bool, DemoError>,
    ) -> Result<(), DemoError> {
        let path = format!("/v1/jobs/{job}/events");
        let request = self
            .agent
            .get(self.url(&path))
            .header("accept", "text/event-stream")
            .header("last-event-id", last.to_string());
        let response = refuse_problem("GET", &path, request.call()?)?;
        let mut name = String::new();
        for line in BufReader::new(response.into_body().into_reader()).lines() {
            let line = line.map_err(ureq::Error::from)?;
            if let Some(value) = line.strip_prefix("id:") {
                *last = value.trim().parse().unwrap_or(*last);
            } else if let Some(value) = line.strip_prefix("event:") {
                value.trim().clone_into(&mut name);
            } else if let Some(data) = line.strip_prefix("data:") {
                let data: Value = serde_json::from_str(data.trim()).unwrap_or(Value::Null);
                if !on_event(&name, &data)? {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }
}

fn refuse_problem(method: &'static str, path: &str, mut response: Response<Body>) -> Result<Response<Body>, DemoError> {
    let status = response.status().as_u16();
    if status < 400 {
        return Ok(response);
    }
    let problem: Value = response.body_mut().read_json().unwrap_or(Value::Null);
    let text = |field: &str| problem[field].as_str().unwrap_or_default().to_owned();
    let mut detail = text("detail");
    if let Some(errors) = problem["errors"].as_array() {
        for error in errors {
            detail.push_str(&format!(
                "; {}: {}",
                error["pointer"].as_str().unwrap_or_default(),
                error["detail"].as_str().unwrap_or_default()
            ));
        }
    }
    Err(DemoError::Problem { method, path: path.to_owned(), status, title: text("title"), detail })
}

fn json(method: &'static str, path: &str, response: Response<Body>) -> Result<Value, DemoError> {
    let mut response = refuse_problem(method, path, response)?;
    if response.status().as_u16() == 204 {
        return Ok(Value::Null);
    }
    Ok(response.body_mut().with_config().limit(MAX_ANSWER).read_json()?)
}
