use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::error::BenchError;
use crate::process::memory_of_mb;

/// The measured server.
#[derive(Debug)]
pub(super) struct Server {
    pub(super) url: String,
    /// Process whose memory is sampled.
    pid: Option<u32>,
    child: Option<Child>,
}

impl Server {
    /// Starts this program's `serve` on a free port, with a data directory and a cache of `cache_mb` MB.
    pub(super) fn start(data: &Path, parallel_jobs: usize, cache_mb: u64) -> Result<Self, BenchError> {
        let program = std::env::current_exe().map_err(|e| failed(&e))?;
        let mut command = Command::new(program);
        command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(data);
        command.env("PROSOPON_PARALLEL_JOBS", parallel_jobs.to_string());
        command.env("PROSOPON_CACHE_MB", cache_mb.to_string()).env("PROSOPON_LOG__LEVEL", "warn");
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::inherit());
        let mut child = command.spawn().map_err(|e| failed(&e))?;
        let mut line = String::new();
        if let Some(out) = child.stdout.take() {
            BufReader::new(out).read_line(&mut line).map_err(|e| failed(&e))?;
        }
        let url = line.trim().strip_prefix("listening on ").map(str::to_owned);
        // The server owns the process before anything can fail, so that the process is always killed.
        let mut server = Self { url: String::new(), pid: Some(child.id()), child: Some(child) };
        server.url = url.ok_or_else(|| failed(&format!("expected `listening on URL` on stdout, found {line:?}")))?;
        Ok(server)
    }

    /// Uses a running server; its memory is sampled when the process id is given.
    pub(super) fn at(url: &str, pid: Option<u32>) -> Self {
        Self { url: url.trim_end_matches('/').to_owned(), pid, child: None }
    }

    /// Memory of the server's process, MB.
    pub(super) fn memory_mb(&self) -> Option<f64> {
        memory_of_mb(self.pid?)
    }
}

fn failed(detail: &dyn std::fmt::Display) -> BenchError {
    BenchError::Row { case: "the server".to_owned(), detail: detail.to_string() }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            child.kill().ok();
            child.wait().ok();
        }
    }
}
