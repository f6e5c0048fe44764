//! `prosopon solve`: solves a scene without a server.

mod scene_file;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, mpsc};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::stop_signal::stop_signal;
use super::{CommandResult, refuse_overwriting};
use prosopon_contract::Findings;
use prosopon_formats::export::vtu_of_mesh;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Point, Vector, VolumeMesh, Warning};
use prosopon_planning::simulate::Scene;
use prosopon_study::peak_mb;
use prosopon_tissue::fem::{SolveError, StepReport};
use scene_file::SceneFile;

/// Arguments of `prosopon solve`.
#[derive(Debug, Args)]
pub(super) struct SolveArguments {
    /// The scene, JSON; paths in it are relative to its folder.
    scene: PathBuf,
    /// VTU file to write the solved mesh to.
    #[arg(long)]
    out: PathBuf,
}

/// The last line on stdout, JSON.
#[derive(Debug, Serialize)]
struct Summary {
    converged: bool,
    /// `stopped` when the path was not finished, else the outcome of the last step; null when no step was reached.
    outcome: Option<&'static str>,
    solve_wall_s: f64,
    total_wall_s: f64,
    peak_mb: Option<f64>,
    newton_iterations: usize,
    unknowns: usize,
    /// Largest penetration of all boundary points into bone, measured from that at rest.
    max_penetration_mm: f64,
    /// Smallest det F at the last step.
    min_det_f: Option<f64>,
    /// Force of each segment on the tissue at the last step, N.
    reactions_n: BTreeMap<u32, [f64; 3]>,
    /// Why the path was not finished or its end is unreliable.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    #[serde(flatten)]
    findings: Findings,
}

/// The last line on stdout when there is no result.
#[derive(Debug, Serialize)]
struct NoResult<'a> {
    converged: bool,
    error: &'a str,
}

/// Why a written result is unreliable.
#[derive(Debug, thiserror::Error)]
enum Unfinished {
    /// The path was not finished.
    #[error(transparent)]
    Stopped(#[from] SolveError),
    /// Forces balance at the end of the path, but the result is unreliable.
    #[error("the path was finished, but its last step is unreliable: {0}")]
    Unreliable(String),
}

pub(super) fn run(arguments: &SolveArguments) -> CommandResult {
    let failure = solve(arguments).inspect_err(|error| {
        let line = serde_json::to_string(&NoResult { converged: false, error: &prosopon_contract::chain(&**error) });
        // A failure to print is ignored: exit status and stderr report the error too.
        let _ = writeln!(std::io::stdout(), "{}", line.unwrap_or_default());
    })?;
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}

/// Solves, and writes the result and the summary; returns why the result is unreliable, if it is.
fn solve(arguments: &SolveArguments) -> Result<Option<Unfinished>, Box<dyn std::error::Error>> {
    let begin = Instant::now();
    let described = SceneFile::read(&arguments.scene)?;
    refuse_overwriting(&arguments.out, &described.files(&arguments.scene))?;
    let out = Output::new(&arguments.out)?;
    let control = Control::new();
    let (stop, stopped) = mpsc::channel();
    on_signal(move || {
        let _ = stop.send(());
    })?;
    let reached = Arc::new(Mutex::new(None));
    let (done, finished) = mpsc::channel();
    {
        let (path, control, reached) = (arguments.scene.clone(), control.clone(), Arc::clone(&reached));
        // Not joined: a factorisation cannot be interrupted, so the thread may not end in time.
        std::thread::spawn(move || drop(done.send(work(&described, &path, &control, &reached))));
    }
    let solved = loop {
        match finished.recv_timeout(LOOK_FOR_SIGNALS) {
            Ok(solved) => break solved.map_err(|error| -> Box<dyn std::error::Error> { error })?,
            Err(mpsc::RecvTimeoutError::Disconnected) => return Err("the solver ended without a result".into()),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
        if stopped.try_recv().is_ok() {
            control.cancel();
            match finished.recv_timeout(TIME_TO_STOP) {
                Ok(solved) => break solved.map_err(|error| -> Box<dyn std::error::Error> { error })?,
                Err(_) => break last_finished_step(reached.lock().ok().and_then(|mut reached| reached.take()))?,
            }
        }
    };
    out.finish(&vtu_of_mesh(&solved.mesh))?;
    let Solved { steps, planned, solve_wall_s, unknowns, mut warnings, failure, .. } = solved;
    if let Some(failure) = &failure {
        let message = format!("stopped after {} of {planned} steps: {failure}", steps.len());
        warnings.push(Warning::unreliable("path-stopped", message));
    }
    let (last, finished) = (steps.last(), failure.is_none());
    let fault = last.and_then(|s| s.outcome.fault()).map(Unfinished::Unreliable);
    let unfinished = failure.map(Unfinished::Stopped).or(fault);
    let summary = Summary {
        converged: unfinished.is_none(),
        outcome: last.map(|s| if finished { s.outcome.name() } else { "stopped" }),
        solve_wall_s,
        total_wall_s: begin.elapsed().as_secs_f64(),
        peak_mb: peak_mb(),
        newton_iterations: steps.iter().map(|s| s.newton_iterations).sum(),
        unknowns,
        max_penetration_mm: last.map_or(0.0, StepReport::deepest_mm),
        min_det_f: last.map(|s| s.min_det_f),
        reactions_n: last.map(|s| s.reactions_n.iter().copied().collect()).unwrap_or_default(),
        error: unfinished.as_ref().map(ToString::to_string),
        findings: warnings.into_iter().collect(),
    };
    writeln!(std::io::stdout(), "{}", serde_json::to_string(&summary)?)?;
    Ok(unfinished)
}

/// Interval between two checks for a signal.
const LOOK_FOR_SIGNALS: Duration = Duration::from_millis(50);
/// Time that the solver has to stop; after it, the last finished step is written.
const TIME_TO_STOP: Duration = Duration::from_millis(1500);

/// Solved mesh and the numbers of the summary.
struct Solved {
    mesh: VolumeMesh,
    steps: Vec<StepReport>,
    /// Steps of the whole path.
    planned: usize,
    solve_wall_s: f64,
    unknowns: usize,
    warnings: Vec<Warning>,
    failure: Option<SolveError>,
}

/// Loads and solves the scene; `reached` always holds the last finished step.
fn work(
    described: &SceneFile,
    path: &Path,
    control: &Control,
    reached: &Mutex<Option<Solved>>,
) -> Result<Solved, Box<dyn std::error::Error + Send + Sync>> {
    let (scene, file, mut warnings) = described.load(path)?;
    let begin = Instant::now();
    let mut steps = Vec::new();
    let outcome = scene.solve_with_steps(None, control, &mut |_, positions, report, _| {
        steps.push(report.clone());
        if let Ok(mut reached) = reached.lock() {
            *reached = Some(Solved {
                mesh: scene.moved_mesh(&file, &moved(&scene, positions)),
                steps: steps.clone(),
                planned: scene.steps,
                solve_wall_s: begin.elapsed().as_secs_f64(),
                unknowns: report.unknowns,
                warnings: Vec::new(),
                failure: Some(SolveError::Cancelled(Cancelled)),
            });
        }
    })?;
    let mesh = scene.solved_mesh(&file, &outcome);
    warnings.extend(outcome.warnings);
    Ok(Solved {
        mesh,
        steps: outcome.steps,
        planned: scene.steps,
        solve_wall_s: begin.elapsed().as_secs_f64(),
        unknowns: outcome.unknowns,
        warnings,
        failure: outcome.failure,
    })
}

fn moved(scene: &Scene, positions: &[Point]) -> Vec<Vector> {
    positions.iter().zip(&scene.ready.mesh.positions).map(|(x, rest)| x - rest).collect()
}

/// The last finished step, for a solver that did not stop in time.
fn last_finished_step(reached: Option<Solved>) -> Result<Solved, SolveError> {
    let mut solved = reached.ok_or(SolveError::Cancelled(Cancelled))?;
    let message = "the solver did not stop in time: the file has the last step's displacements, no stresses";
    solved.warnings.push(Warning::check("no-stresses", message));
    Ok(solved)
}

/// Calls `stop` on SIGINT or SIGTERM.
fn on_signal(stop: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let signal = {
        let _within = runtime.enter();
        stop_signal()?
    };
    std::thread::spawn(move || {
        runtime.block_on(signal);
        stop();
    });
    Ok(())
}

/// An output file that is written completely or not at all.
///
/// It is written as `NAME.part` and then renamed. A path that cannot be written to is refused before the work starts.
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
        // After a success the file no longer exists.
        let _ = std::fs::remove_file(&self.part);
    }
}
