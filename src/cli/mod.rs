//! The command line of `prosopon`.
//!
//! Invariants: commands only call the library; no other module writes to stdout.

mod bench;
mod check;
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

/// Predict the face after jaw surgery. Not a medical device.
#[derive(Debug, Parser)]
#[command(name = "prosopon", version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serve the HTTP API and compute jobs.
    Serve(serve::ServeArguments),
    /// Compute jobs for the API processes on the same database; its address serves only health and metrics.
    Worker(serve::ServeArguments),
    /// Solve a scene on a ready mesh, without a server.
    Solve(solve::SolveArguments),
    /// Run the main job on a phantom head or a patient, over HTTP, and write the results.
    Demo(crate::demo::DemoArgs),
    /// Compare two surfaces: signed error map, picture and statistics.
    Compare(compare::CompareArguments),
    /// Report what the service would read from files: frame, units, size, orientation, values, findings.
    Check(check::CheckArguments),
    /// Read a CT as the service does: convert, compare, extract surfaces.
    #[command(subcommand)]
    Ct(ct::CtCommand),
    /// Run the studies behind the charts.
    #[command(subcommand)]
    Bench(bench::BenchCommand),
    /// Check the configuration.
    #[command(subcommand)]
    Config(operate::ConfigCommand),
    /// Create API keys.
    #[command(subcommand)]
    Auth(operate::AuthCommand),
    /// Make keys for encryption at rest.
    #[command(subcommand)]
    Encryption(operate::EncryptionCommand),
    /// Verify the audit log.
    #[command(subcommand)]
    Audit(operate::AuditCommand),
    /// Upgrade a Postgres database to this version's format, as the start of a service does.
    Migrate(operate::MigrateArguments),
    /// Back up the store of a data directory; the service may be running.
    Backup(operate::BackupArguments),
    /// Find damaged or missing values in a data directory; the service may be running.
    Scrub(operate::ScrubArguments),
    /// Restore a backup into a directory without a store.
    Restore(operate::RestoreArguments),
    /// Print the description of the API, OpenAPI 3.1.
    Openapi,
}

/// Refuses an output that would overwrite one of its inputs, also through another name of the same file.
fn refuse_overwriting(out: &Path, inputs: &[PathBuf]) -> Result<(), String> {
    let Ok(place) = out.canonicalize() else { return Ok(()) };
    let same = inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == place));
    if same { Err(format!("{} is an input: give another file for the result", out.display())) } else { Ok(()) }
}

/// Runs the command in the arguments of this process and returns its exit status.
#[must_use]
pub fn run() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Worker(arguments) => serve::work(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Ct(command) => ct::run(&command),
        Command::Bench(command) => bench::run(&command),
        Command::Config(command) => operate::config(&command),
        Command::Auth(command) => operate::auth(&command),
        Command::Audit(command) => operate::audit(&command),
        Command::Migrate(arguments) => operate::migrate(&arguments),
        Command::Encryption(command) => operate::encryption(&command),
        Command::Backup(arguments) => operate::backup(&arguments),
        Command::Scrub(arguments) => operate::scrub_store(&arguments),
        Command::Restore(arguments) => operate::restore_from(&arguments),
        Command::Openapi => openapi::run(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            writeln!(std::io::stderr(), "prosopon: {}", prosopon_contract::chain(error.as_ref())).ok();
            ExitCode::FAILURE
        }
    }
}

/// Result of a command.
type CommandResult = Result<(), Box<dyn std::error::Error>>;
