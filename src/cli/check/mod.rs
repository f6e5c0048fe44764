//! `prosopon check`: what the service would read from files, without a session.

mod report;
mod text;

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use self::report::{Checked, FileReport};
use super::CommandResult;
use super::ct::ReadArguments;

/// Files to read as the service does.
#[derive(Debug, Args)]
pub(super) struct CheckArguments {
    /// Files of any kind that the service takes; a folder is a DICOM series.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadArguments,
    /// Print JSON, one object with the reports of all files.
    #[arg(long)]
    json: bool,
}

/// Reports what each file holds; fails when one of them cannot be used.
pub(super) fn run(arguments: &CheckArguments) -> CommandResult {
    let settings = arguments.reading.settings();
    let reports: Vec<FileReport> =
        arguments.files.iter().map(|file| FileReport::of(file, &settings)).collect::<Result<_, _>>()?;
    let together = report::together(&reports)?;
    let mut out = std::io::stdout().lock();
    if arguments.json {
        serde_json::to_writer_pretty(&mut out, &serde_json::json!({ "files": reports, "together": together }))?;
        writeln!(out)?;
    } else {
        for report in &reports {
            text::write(&mut out, report)?;
        }
        text::findings(&mut out, &together)?;
    }
    let refused = reports.iter().filter(|report| matches!(report.checked, Checked::Refused { .. })).count();
    if refused > 0 { Err(format!("{refused} of {} files cannot be used", reports.len()).into()) } else { Ok(()) }
}
