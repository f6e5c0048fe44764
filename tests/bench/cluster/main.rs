//! Compares several processes on Postgres and a bucket with one process on its own disk.
//!
//! The benchmark measures queue operations, throughput of small jobs, takeover of a killed worker's job, and overhead of a
//! job. `cargo bench --bench cluster [-- queue throughput takeover overhead]` prints a table and writes
//! `target/cluster.csv`. It needs Debian's `postgresql`, like the tests of the shared store. Postgres runs with `fsync`, as
//! in a hospital; this program serves the bucket.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a benchmark stops where something is wrong"
)]

#[allow(dead_code, reason = "the tests' client; this uses a part of it")]
#[path = "../../http/support/binary.rs"]
mod binary;
#[path = "../../engines/mod.rs"]
mod engines;
mod processes;
mod queue;

use std::fmt::Write;
use std::time::Instant;

use engines::{Bucket, Cluster};
use processes::{Site, Solves, busy_s};

/// A measured value.
struct Row {
    what: String,
    engine: &'static str,
    /// Number of claimers, of jobs at the same time, or of worker processes.
    clients: usize,
    value: f64,
    unit: &'static str,
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let (bucket, cluster) = (runtime.block_on(Bucket::start()), Cluster::start_with(true));
    let site = Site { runtime: &runtime, cluster: &cluster, bucket: &bucket };
    let parts: [(&str, fn(&Site) -> Vec<Row>); 4] =
        [("queue", queue::operations), ("throughput", throughput), ("takeover", takeover), ("overhead", overhead)];
    let mut table = String::from("what,engine,clients,value,unit\n");
    for (name, part) in parts {
        if !wanted.is_empty() && !wanted.iter().any(|w| w == name) {
            continue;
        }
        for row in part(&site) {
            let line = format!("{},{},{},{:.3},{}", row.what, row.engine, row.clients, row.value, row.unit);
            println!("{line}");
            writeln!(table, "{line}").unwrap();
        }
    }
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/target/cluster.csv"), table).unwrap();
}

/// Small jobs (linear model, coarse phantom, two steps) per second, all posted at once, and the cores that all processes
/// keep busy.
fn throughput(site: &Site) -> Vec<Row> {
    const JOBS: usize = 60;
    let mut rows = Vec::new();
    for (engine, clients) in
        [("embedded", 1), ("embedded", 2), ("embedded", 4), ("shared", 1), ("shared", 2), ("shared", 4)]
    {
        let group = if engine == "embedded" { site.embedded(clients) } else { site.shared(clients, &[]) };
        let mut solves = Solves::new(&group.api, 5, 9.0, "linear", 2);
        // Warm-up: every worker loads every session, so that first jobs are not measured.
        (0..5 * clients.max(2)).map(|_| solves.post()).collect::<Vec<_>>().iter().for_each(|job| solves.finish(job));
        // Plans are made beforehand: the API process checks their paths for overlap, which would limit the throughput.
        let plans: Vec<_> = (0..JOBS).map(|_| solves.plan()).collect();
        let (started, busy) = (Instant::now(), busy_s());
        plans
            .iter()
            .map(|plan| solves.post_planned(plan))
            .collect::<Vec<_>>()
            .iter()
            .for_each(|job| solves.finish(job));
        let seconds = started.elapsed().as_secs_f64();
        let row = |what: &str, value, unit| Row { what: what.to_owned(), engine, clients, value, unit };
        rows.push(row("small jobs", JOBS as f64 / seconds, "1/s"));
        rows.push(row("small jobs: processors busy", (busy_s() - busy) / seconds, ""));
    }
    rows
}

/// Time from the kill of a worker during a solve to the restart of its job by another one: median of five, leases of 2, 3 (the default) and 15 s.
fn takeover(site: &Site) -> Vec<Row> {
    let measure = |lease_s: &'static str| {
        let mut times: Vec<f64> = Vec::new();
        for _ in 0..5 {
            let mut group = site.shared(1, &[("PROSOPON_LEASE_S", lease_s)]);
            let job = Solves::new(&group.api, 1, 8.0, "mixed", 16).post();
            let mut stream = group.api.stream(&format!("{job}/events"));
            while stream.next_event()["event"] != "step" {}
            let killed = group.workers.pop();
            group.add_worker(site, &[("PROSOPON_LEASE_S", lease_s)]);
            let started = Instant::now();
            drop(killed);
            while stream.next_event()["data"]["attempt"] != 2 {}
            times.push(started.elapsed().as_secs_f64());
        }
        let what = format!("takeover with a lease of {lease_s} s");
        Row { what, engine: "shared", clients: 2, value: median(times), unit: "s" }
    };
    vec![measure("2"), measure("3"), measure("15")]
}

/// Time of a solve of about five seconds from the request to its end, alternating between the two stores, and the ratio.
fn overhead(site: &Site) -> Vec<Row> {
    const ROUNDS: usize = 7;
    let groups = [("embedded", site.embedded(1)), ("shared", site.shared(1, &[]))];
    let mut solves = groups.each_ref().map(|(_, group)| Solves::new(&group.api, 1, 6.0, "mixed", 10));
    let mut times = [Vec::new(), Vec::new()];
    for round in 0..=ROUNDS {
        for (solves, times) in solves.iter_mut().zip(&mut times) {
            let started = Instant::now();
            let job = solves.post();
            solves.finish(&job);
            // The first solve computes the factorisation and is not counted.
            if round > 0 {
                times.push(started.elapsed().as_secs_f64());
            }
        }
    }
    let [own, shared] = times.map(median);
    let row = |what: &str, engine, value, unit| Row { what: what.to_owned(), engine, clients: 1, value, unit };
    vec![
        row("solve", "embedded", own, "s"),
        row("solve", "shared", shared, "s"),
        row("solve: shared to embedded", "shared", shared / own, ""),
    ]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
