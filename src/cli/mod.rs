//! The command line.
//!
//! Invariant: everything it does is a call of the library; it alone writes to stdout.

mod bench;
mod compare;
mod ct;
mod demo;
mod openapi;
mod operate;
mod serve;
mod solve;
mod stop_signal;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Predicts the face after the jaw is cut and moved. Not a medical device.
#[derive(Debug, Parser)]
#[command(name = "prosopon", version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the HTTP API.
    Serve(serve::ServeArguments),
    /// Compute jobs for the processes that serve the API on the same database; at its address are only health and metrics.
    Worker(serve::ServeArguments),
    /// Solve a scene on a ready mesh, without a server.
    Solve(solve::SolveArguments),
    /// Run the main job on a phantom head or a patient, over HTTP, and write the results.
    Demo(crate::demo::DemoArgs),
    /// Compare two surfaces: signed error map, picture and statistics.
    Compare(compare::CompareArguments),
    /// Read a CT as the service does: convert, compare, take surfaces.
    #[command(subcommand)]
    Ct(ct::CtCommand),
    /// Measure: the studies behind the charts.
    #[command(subcommand)]
    Bench(bench::BenchCommand),
    /// Look at the configuration.
    #[command(subcommand)]
    Config(operate::ConfigCommand),
    /// Make API keys.
    #[command(subcommand)]
    Auth(operate::AuthCommand),
    /// Look at the audit log.
    #[command(subcommand)]
    Audit(operate::AuditCommand),
    /// Bring a Postgres database to this version's format, as the start of a service does.
    Migrate(operate::MigrateArguments),
    /// Copy the store in a data directory, also while the service runs.
    Backup(operate::BackupArguments),
    /// Read every stored value of a data directory, also while the service runs: which are damaged or missing?
    Scrub(operate::ScrubArguments),
    /// Put a backup into an empty directory.
    Restore(operate::RestoreArguments),
    /// Print the API's description, OpenAPI 3.1.
    Openapi,
}

/// Refuses a result that would take the place of a file that it is made from, under whatever name.
fn refuse_overwriting(out: &Path, inputs: &[PathBuf]) -> Result<(), String> {
    let Ok(place) = out.canonicalize() else { return Ok(()) };
    let same = inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == place));
    if same { Err(format!("{} is an input: name another place for the result", out.display())) } else { Ok(()) }
}

/// Runs the command that the process was called with.
#[must_use]
pub fn run() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Worker(arguments) => serve::work(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Ct(command) => ct::run(&command),
        Command::Bench(command) => bench::run(&command),
        Command::Config(command) => operate::config(&command),
        Command::Auth(command) => operate::auth(&command),
        Command::Audit(command) => operate::audit(&command),
        Command::Migrate(arguments) => operate::migrate(&arguments),
        Command::Backup(arguments) => operate::backup(&arguments),
        Command::Scrub(arguments) => operate::scrub_store(&arguments),
        Command::Restore(arguments) => operate::restore_from(&arguments),
        Command::Openapi => openapi::run(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            writeln!(std::io::stderr(), "prosopon: {}", prosopon_session::chain(error.as_ref())).ok();
            ExitCode::FAILURE
        }
    }
}

/// What a command comes back with.
type CommandResult = Result<(), Box<dyn std::error::Error>>;
