//! `prosopon solve`: a scene without a server.

mod scene_file;

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::CommandResult;
use crate::bench::peak_mb;
use crate::control::Control;
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
    solve_wall_s: f64,
    total_wall_s: f64,
    peak_mb: Option<f64>,
    newton_iterations: usize,
    unknowns: usize,
    max_penetration_mm: f64,
    warnings: Vec<String>,
}

pub(super) fn run(arguments: &SolveArguments) -> CommandResult {
    let begin = Instant::now();
    let (scene, file, mut warnings) = SceneFile::read(&arguments.scene)?.load(&arguments.scene)?;
    let solve_begin = Instant::now();
    let outcome = scene.solve(&Control::new())?;
    let solve_wall_s = solve_begin.elapsed().as_secs_f64();
    let bytes = scene.file(&file, &outcome);
    std::fs::write(&arguments.out, bytes).map_err(|e| format!("cannot write {}: {e}", arguments.out.display()))?;

    warnings.extend(outcome.warnings);
    if let Some(failure) = &outcome.failure {
        warnings.push(format!("stopped after {} of {} steps: {failure}", outcome.steps.len(), scene.steps));
    }
    let last = outcome.steps.last();
    let summary = Summary {
        converged: outcome.failure.is_none(),
        solve_wall_s,
        total_wall_s: begin.elapsed().as_secs_f64(),
        peak_mb: peak_mb(),
        newton_iterations: outcome.steps.iter().map(|s| s.newton_iterations).sum(),
        unknowns: outcome.unknowns,
        max_penetration_mm: last.map_or(0.0, |s| s.max_penetration_mm),
        warnings,
    };
    writeln!(std::io::stdout(), "{}", serde_json::to_string(&summary)?)?;
    match outcome.failure {
        None => Ok(()),
        Some(failure) => Err(failure.into()),
    }
}
