use std::io::Write;
use std::path::Path;
use std::time::Duration;

use plotters::prelude::RGBColor;

use super::latencies::{Kind, Latencies, percentile};
use super::load::{Load, Loaded};
use super::memory::{self, Plateau, Sample};
use super::server::Server;
use crate::chart::{self, Curve, Labels};
use crate::error::{BenchError, write};
use crate::files::{Scratch, refuse_unwritable};

/// Goal for the 99th percentile of status reads, ms.
const GOAL_MS: f64 = 50.0;
/// Goal for the relative growth of memory from the third to the last quarter of the small jobs.
const GOAL_GROWTH: f64 = 0.05;
/// Size of the server's cache, MB: small, so that the jobs fill it early.
const CACHE_MB: u64 = 64;

/// Loads a server and measures the latency of status reads, the number of errors and the memory of the server.
#[derive(Debug)]
pub struct ServiceStudy<'a> {
    /// CSV file to write; the charts and the memory samples have the same name with other extensions.
    pub csv: &'a Path,
    /// URL of a running server; without it, one is started for each part.
    pub url: Option<&'a str>,
    /// Process id of that server, to sample its memory.
    pub pid: Option<u32>,
    /// Duration of the load, s.
    pub seconds: f64,
    /// Number of small jobs after the load; with 0 the memory is not measured.
    pub jobs: usize,
    /// Clients that read the status of jobs and sessions.
    pub pollers: usize,
    /// Clients that follow the events of jobs.
    pub followers: usize,
    /// Number of sessions.
    pub sessions: usize,
    /// Solves at the same time.
    pub solvers: usize,
    /// Pause of a poller between two reads, ms.
    pub pause_ms: u64,
}

impl ServiceStudy<'_> {
    /// Runs the study and prints to `out`; returns whether all goals are met.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<bool, BenchError> {
        let beside = |end: &str| self.csv.with_extension(end);
        for place in [self.csv, &beside("memory.csv")] {
            refuse_unwritable(place)?;
        }
        let scratch = Scratch::new()?;
        let server = self.server(&scratch.path("load"), self.solvers)?;
        let load = Load {
            sessions: self.sessions,
            pollers: self.pollers,
            followers: self.followers,
            uploaders: 2,
            solvers: self.solvers,
            seconds: self.seconds,
            pause: Duration::from_millis(self.pause_ms),
            upload_pause: Duration::from_secs(1),
        };
        let loaded = load.run(&server.url)?;
        drop(server);
        let reads_are_quick = self.report_load(&loaded, out)?;
        write(&beside("svg"), latency_chart(&loaded.latencies)?.as_bytes())?;

        if self.jobs == 0 {
            return Ok(reads_are_quick && loaded.latencies.errors() == 0);
        }
        let server = self.server(&scratch.path("memory"), 1)?;
        let (samples, latencies) = memory::run(&server, self.jobs)?;
        drop(server);
        let is_flat = self.report_memory(&samples, &latencies, out)?;
        writeln!(out, "wrote {} and beside it .svg, .memory.csv, .memory.svg", self.csv.display())?;
        Ok(reads_are_quick && is_flat && loaded.latencies.errors() + latencies.errors() == 0)
    }

    fn server(&self, data: &Path, parallel_jobs: usize) -> Result<Server, BenchError> {
        match self.url {
            Some(url) => Ok(Server::at(url, self.pid)),
            None => Server::start(data, parallel_jobs, CACHE_MB),
        }
    }

    fn report_load(&self, loaded: &Loaded, out: &mut dyn Write) -> Result<bool, BenchError> {
        let latencies = &loaded.latencies;
        writeln!(
            out,
            "{} sessions, {} pollers, {} followers, {} solvers, 2 uploaders for {:.0} s: {} solves, {} events, {} errors{}",
            self.sessions,
            self.pollers,
            self.followers,
            self.solvers,
            loaded.seconds,
            loaded.solved,
            loaded.events,
            latencies.errors(),
            latencies.first_error.as_ref().map_or(String::new(), |e| format!(" (the first: {e})")),
        )?;
        let mut csv = String::from("what,requests,errors,p50_ms,p95_ms,p99_ms,max_ms\n");
        let status: &[Kind] = &[Kind::Job, Kind::Session];
        let each = Kind::TOLD.map(|k| (k.name(), vec![k]));
        for (name, kinds) in std::iter::once(("status reads", status.to_vec())).chain(each) {
            let ms = latencies.sorted_ms(&kinds);
            let errors: usize = kinds.iter().map(|k| latencies.errors_of(*k)).sum();
            let [p50, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| percentile(&ms, share));
            csv += &format!("{name},{},{errors},{p50:.2},{p95:.2},{p99:.2},{max:.2}\n", ms.len());
        }
        write!(out, "{csv}")?;
        write(self.csv, csv.as_bytes())?;
        Ok(percentile(&latencies.sorted_ms(status), 0.99) < GOAL_MS)
    }

    fn report_memory(
        &self,
        samples: &[Sample],
        latencies: &Latencies,
        out: &mut dyn Write,
    ) -> Result<bool, BenchError> {
        let mut csv = String::from("jobs,wall_s,memory_mb\n");
        for s in samples {
            csv += &format!("{},{:.2},{:.1}\n", s.jobs, s.wall_s, s.memory_mb);
        }
        write(&self.csv.with_extension("memory.csv"), csv.as_bytes())?;
        let wall_s = samples.last().map_or(0.0, |s| s.wall_s);
        writeln!(out, "{} small jobs in {wall_s:.0} s, {} errors", self.jobs, latencies.errors())?;
        let Some(plateau) = Plateau::of(samples) else {
            writeln!(out, "the memory of the server is unknown: give its process id with --pid")?;
            return Ok(self.url.is_some());
        };
        let growth = plateau.growth();
        writeln!(
            out,
            "memory of the server: {:.1} MB in the third quarter, {:.1} MB in the last ({:+.1} %)",
            plateau.third_mb,
            plateau.last_mb,
            100.0 * growth
        )?;
        write(&self.csv.with_extension("memory.svg"), memory_chart(samples)?.as_bytes())?;
        Ok(growth < GOAL_GROWTH)
    }
}

/// Chart of the time that one request in N exceeds.
fn latency_chart(latencies: &Latencies) -> Result<String, BenchError> {
    let colours = [(0, 114, 178), (0, 158, 115), (213, 94, 0), (204, 121, 167), (86, 180, 233)];
    let curves: Vec<Curve> = Kind::TOLD
        .into_iter()
        .zip(colours)
        .map(|(kind, (r, g, b))| {
            let ms = latencies.sorted_ms(&[kind]);
            let most = ms.len() as f64;
            let points = [2.0, 4.0, 10.0, 20.0, 100.0, 200.0, 1000.0, 10_000.0].into_iter().filter(|n| *n <= most);
            let points = points.map(|n| (n, percentile(&ms, 1.0 - 1.0 / n))).collect();
            Curve { name: kind.name().to_owned(), color: RGBColor(r, g, b), points, marks: Vec::new() }
        })
        .collect();
    let labels = Labels { title: "Latency under load that one request in N exceeds", x: "N", y: "ms" };
    chart::draw(&labels, &curves)
}

fn memory_chart(samples: &[Sample]) -> Result<String, BenchError> {
    let points = samples.iter().map(|s| (s.jobs as f64, s.memory_mb)).collect();
    let curve = Curve { name: "resident".to_owned(), color: RGBColor(0, 114, 178), points, marks: Vec::new() };
    let labels = Labels { title: "Memory of the server over small jobs", x: "jobs done", y: "MB" };
    chart::draw_linear(&labels, &[curve])
}
