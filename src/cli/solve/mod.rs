//! `prosopon solve`: a scene without a server.

mod scene_file;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::stop_signal::stop_signal;
use super::{CommandResult, refuse_overwriting};
use prosopon_formats::export::vtu_of_mesh;
use prosopon_geometry::control::Control;
use prosopon_study::peak_mb;
use prosopon_tissue::fem::SolveError;
use scene_file::SceneFile;

/// Arguments of `prosopon solve`.
#[derive(Debug, Args)]
pub(super) struct SolveArguments {
    /// The scene, JSON. Files that it names are looked for in its folder.
    scene: PathBuf,
    /// The solved mesh goes here, VTU.
    #[arg(long)]
    out: PathBuf,
}

/// The last line on stdout.
#[derive(Debug, Serialize)]
struct Summary {
    converged: bool,
    /// How the path ended: `stopped` before its end, or as its last step did; null when no step was reached.
    outcome: Option<&'static str>,
    solve_wall_s: f64,
    total_wall_s: f64,
    peak_mb: Option<f64>,
    newton_iterations: usize,
    unknowns: usize,
    max_penetration_mm: f64,
    warnings: Vec<String>,
}

/// The last line on stdout when there is no result.
#[derive(Debug, Serialize)]
struct NoResult<'a> {
    converged: bool,
    error: &'a str,
}

/// Why a result that was written is not to be relied on.
#[derive(Debug, thiserror::Error)]
enum Unfinished {
    /// The path was not finished.
    #[error(transparent)]
    Stopped(#[from] SolveError),
    /// Forces balance at its end, but no more.
    #[error("the path was finished, but its end is not to be relied on: {0}")]
    NotToRelyOn(String),
}

pub(super) fn run(arguments: &SolveArguments) -> CommandResult {
    let failure = solve(arguments).inspect_err(|error| {
        let line = serde_json::to_string(&NoResult { converged: false, error: &prosopon_session::chain(&**error) });
        // The exit status and stderr tell it too.
        let _ = writeln!(std::io::stdout(), "{}", line.unwrap_or_default());
    })?;
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}

/// Solves, writes the result and the summary; why it is not to be relied on.
fn solve(arguments: &SolveArguments) -> Result<Option<Unfinished>, Box<dyn std::error::Error>> {
    let begin = Instant::now();
    let described = SceneFile::read(&arguments.scene)?;
    refuse_overwriting(&arguments.out, &described.files(&arguments.scene))?;
    let (scene, file, mut warnings) = described.load(&arguments.scene)?;
    let control = stoppable()?;
    let out = Output::new(&arguments.out)?;
    let solve_begin = Instant::now();
    let outcome = scene.solve(&control)?;
    let solve_wall_s = solve_begin.elapsed().as_secs_f64();
    out.finish(&vtu_of_mesh(&scene.solved_mesh(&file, &outcome)))?;

    warnings.extend(outcome.warnings);
    if let Some(failure) = &outcome.failure {
        warnings.push(format!("stopped after {} of {} steps: {failure}", outcome.steps.len(), scene.steps));
    }
    let (last, finished) = (outcome.steps.last(), outcome.failure.is_none());
    let fault = last.and_then(|s| s.outcome.fault()).map(Unfinished::NotToRelyOn);
    let unfinished = outcome.failure.map(Unfinished::Stopped).or(fault);
    let summary = Summary {
        converged: unfinished.is_none(),
        outcome: last.map(|s| if finished { s.outcome.name() } else { "stopped" }),
        solve_wall_s,
        total_wall_s: begin.elapsed().as_secs_f64(),
        peak_mb: peak_mb(),
        newton_iterations: outcome.steps.iter().map(|s| s.newton_iterations).sum(),
        unknowns: outcome.unknowns,
        max_penetration_mm: last.map_or(0.0, |s| s.max_penetration_mm),
        warnings,
    };
    writeln!(std::io::stdout(), "{}", serde_json::to_string(&summary)?)?;
    Ok(unfinished)
}

/// A control that a signal to stop cancels: what was reached by then is written and told.
fn stoppable() -> std::io::Result<Control> {
    let control = Control::new();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let signal = {
        let _within = runtime.enter();
        stop_signal()?
    };
    let stopped = control.clone();
    std::thread::spawn(move || {
        runtime.block_on(signal);
        stopped.cancel();
    });
    Ok(control)
}

/// A file that is there whole or not at all: written beside its place, then moved there. A place that cannot be written to is
/// refused before the work.
struct Output<'a> {
    path: &'a Path,
    part: PathBuf,
}

impl<'a> Output<'a> {
    fn new(path: &'a Path) -> Result<Self, String> {
        let name = path
            .file_name()
            .filter(|_| !path.is_dir())
            .ok_or_else(|| format!("cannot write {}: it is a folder", path.display()))?;
        let mut part = name.to_owned();
        part.push(".part");
        let out = Self { path, part: path.with_file_name(part) };
        std::fs::File::create(&out.part).map_err(|e| out.fault(&e))?;
        Ok(out)
    }

    fn finish(self, bytes: &[u8]) -> Result<(), String> {
        std::fs::write(&self.part, bytes)
            .and_then(|()| std::fs::rename(&self.part, self.path))
            .map_err(|e| self.fault(&e))
    }

    fn fault(&self, error: &std::io::Error) -> String {
        format!("cannot write {}: {error}", self.path.display())
    }
}

impl Drop for Output<'_> {
    fn drop(&mut self) {
        // Gone already after a success.
        let _ = std::fs::remove_file(&self.part);
    }
}
