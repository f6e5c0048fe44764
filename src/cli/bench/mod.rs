mod heads;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};

use super::CommandResult;
use heads::{
    AssumptionArguments, BudgetArguments, OperationArguments, PoseArguments, ProposalArguments, RatioArguments,
};
use prosopon_field::{FieldSettings, Method, MethodSettings, Tolerance};
use prosopon_study::{
    BoundStudy, CollisionStudy, ContactStudy, CutStudy, FieldStudy, GrowthStudy, HeadSource, ModelCase, ModelStudy,
    ReachStudy, ServiceStudy, SlabCase, SolverGrowthStudy, StabilityStudy, TruthStudy, WarmStartStudy, evaluate,
    run_model_cases, run_slab_case,
};

/// Studies of `prosopon bench`.
#[derive(Debug, Subcommand)]
pub(super) enum BenchCommand {
    /// Distance fields: time, memory and error of every builder; or the distances of one builder at given points.
    Field(FieldArguments),
    /// Proven bounds on the error of the adaptive field, checked at a million points.
    Bounds(BoundArguments),
    /// Build time of a field against the number of triangles, 12 000 to a million.
    Growth(GrowthArguments),
    /// Collision detection along a path: time against tolerance.
    Collision(CollisionArguments),
    /// Time and error of every mechanical model on several meshes of one head, against a refined reference.
    Models(ModelArguments),
    /// Forty operations on several heads: share of reliable solves and time of each solve.
    Operations(OperationArguments),
    /// How far the face moves when one modelling choice at a time is changed; a tornado chart.
    Assumptions(AssumptionArguments),
    /// What finer meshes and other elements cost and bring; fits the table by which `auto` keeps a budget.
    Budget(BudgetArguments),
    /// Soft-to-hard ratios of four operations on several heads, beside published ranges.
    Ratios(RatioArguments),
    /// Distances of proposed landmarks from known ones.
    Proposals(ProposalArguments),
    /// Frame of each head, and how far that of the same head in other poses is from it.
    Poses(PoseArguments),
    /// Time saved and error made by leaving out tissue that a plan hardly moves.
    Reach(ReachArguments),
    /// Time of a session's second job when it starts from the result of the first one.
    WarmStart(ReachArguments),
    /// Solver time by phase on a slab of 19 000 to 490 000 tetrahedra.
    SolverGrowth(SolverGrowthArguments),
    /// Registration and error map against a synthetic truth: the skin of a finer model, scanned with noise and displaced.
    Truth(TruthArguments),
    /// Every mechanical model on scenes that are hard to solve; each result is checked.
    Stability(StabilityArguments),
    /// The service under load: latency of status reads, and memory over a thousand small jobs.
    Service(ServiceArguments),
    /// Random cuts and paths on a skull: each result must be correct or refused with a reason.
    Cuts(CutArguments),
    /// Newton's method on 20 000 points that a penalty pushes out of bone: share that converges with each kind of field.
    Contacts(ContactArguments),
}

/// Name of a field builder on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum MethodName {
    Uniform,
    Frisken,
    Hybrid,
    Adaptive,
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Uniform => Self::Uniform,
            MethodName::Frisken => Self::Frisken,
            MethodName::Hybrid => Self::Hybrid,
            MethodName::Adaptive => Self::Adaptive,
        }
    }
}

#[derive(Debug, Args)]
pub(super) struct FieldArguments {
    /// Surface: STL, PLY, OBJ or VTP, mm.
    #[arg(long)]
    mesh: PathBuf,
    /// Study all builders: CSV file to write; the charts are written next to it.
    #[arg(long, required_unless_present = "points", conflicts_with = "points")]
    csv: Option<PathBuf>,
    /// With --csv: run all six settings of the paper's Table 3 instead of the four coarser ones.
    #[arg(long, requires = "csv")]
    full: bool,
    /// With --csv: also measure this program, which builds a level set with OpenVDB (`tests/bench/openvdb.cpp`).
    #[arg(long, requires = "csv")]
    openvdb: Option<PathBuf>,
    /// Evaluate one builder at the points of this file: their number (u64), then x, y, z of each (f64), little-endian, mm.
    #[arg(long, requires = "out")]
    points: Option<PathBuf>,
    /// With --points: file to write the distances to, f64, little-endian, no header.
    #[arg(long, requires = "points")]
    out: Option<PathBuf>,
    /// With --points: builder of the field.
    #[arg(long, value_enum, default_value = "adaptive", requires = "points")]
    method: MethodName,
    /// With --points: finest spacing, mm.
    #[arg(long, requires = "points", conflicts_with = "resolution")]
    spacing_mm: Option<f64>,
    /// With --points: cells along the edge of the bounding cube.
    #[arg(long, requires = "points")]
    resolution: Option<u32>,
    /// With --points: tolerance of frisken and hybrid, relative to the edge of the bounding cube.
    #[arg(long, requires = "points")]
    tolerance: Option<f64>,
    /// With --points: half-width of the band with full accuracy, mm.
    #[arg(long, requires = "points")]
    band_mm: Option<f64>,
    /// With --points: margin of the grid around the surface, mm.
    #[arg(long, requires = "points")]
    margin_mm: Option<f64>,
    /// JSON file for the times and memory of the build and the queries.
    #[arg(long, requires = "points", hide = true)]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct BoundArguments {
    /// Closed surface: STL, PLY, OBJ or VTP, mm.
    #[arg(long)]
    mesh: PathBuf,
    /// Finest spacing, mm.
    #[arg(long, default_value_t = FieldSettings::default().spacing_mm)]
    spacing_mm: f64,
    /// Half-width of the band, mm.
    #[arg(long, default_value_t = FieldSettings::default().band_mm)]
    band_mm: f64,
    /// Time limit of the proof in the band, s; the output says for which share of the domain the bound is proven.
    #[arg(long, default_value_t = 120.0)]
    most_s: f64,
}

#[derive(Debug, Args)]
pub(super) struct GrowthArguments {
    /// Surface: STL, PLY, OBJ or VTP, mm; the study decimates and subdivides it.
    #[arg(long)]
    mesh: PathBuf,
    /// CSV file to write; the chart is written next to it.
    #[arg(long)]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct CollisionArguments {
    /// Surface of the skull.
    #[arg(long)]
    mesh: PathBuf,
    /// Surface of the skin.
    #[arg(long, alias = "tissue")]
    skin: PathBuf,
    /// JSON with `le_fort_1_plane` {`point`, `normal`}, `midline_x_mm` and `occlusal_plane_z_mm`.
    #[arg(long)]
    landmarks: PathBuf,
    /// CSV file to write; the chart is written next to it.
    #[arg(long)]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct ContactArguments {
    /// Surface of bone.
    #[arg(long)]
    mesh: PathBuf,
    /// CSV file to write.
    #[arg(long)]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct CutArguments {
    /// Surface of the skull: STL, PLY, OBJ or VTP, mm.
    #[arg(long)]
    skull: PathBuf,
    /// JSON with `landmarks`, `midline_x_mm`, `occlusal_plane_z_mm` and `le_fort_1_plane`; with it, templates are tried too.
    #[arg(long)]
    landmarks: Option<PathBuf>,
    /// Number of cuts, and number of paths.
    #[arg(long, default_value_t = 100)]
    count: usize,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// CSV file to write.
    #[arg(long, default_value = "cuts.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct ModelArguments {
    /// Heads side by side: `phantom`, or a folder with `landmarks.json` and a CT (*.nii.gz) or the surfaces skin.* and skull.*.
    #[arg(long, value_delimiter = ',', required = true)]
    scene: Vec<HeadSource>,
    /// Lines of the chart: name and time, s.
    #[arg(long, value_parser = line, default_value = "paper (2009), 129 856 tetrahedra=1230")]
    line: Vec<(String, f64)>,
    /// CSV file to write; the chart is written next to it.
    #[arg(long, default_value = "models.csv")]
    csv: PathBuf,
    /// Edge lengths of the meshes, mm.
    #[arg(long, value_delimiter = ',', default_value = "7,5.5,4.5,3.7")]
    edges_mm: Vec<f64>,
    /// Edge length of the reference mesh, mm; must be smaller than all --edges-mm.
    #[arg(long, default_value_t = 3.0)]
    reference_mm: f64,
    /// Run only these cases, all with the same mesh.
    #[arg(long, hide = true, value_delimiter = ',', requires = "out", requires = "timing")]
    cases: Vec<ModelCase>,
    /// With --cases: file to write the displacements to.
    #[arg(long, hide = true, requires = "cases")]
    out: Option<PathBuf>,
    /// With --cases: JSON file for their times and memory.
    #[arg(long, hide = true, requires = "cases")]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct ReachArguments {
    /// `phantom`, or a folder as for `models`.
    #[arg(long)]
    scene: HeadSource,
    /// Edge length of the mesh, mm.
    #[arg(long, default_value_t = 4.0)]
    edge_mm: f64,
    /// CSV file to write [default: reach.csv or warm-start.csv].
    #[arg(long)]
    csv: Option<PathBuf>,
}

impl ReachArguments {
    fn csv<'a>(&'a self, usual: &'a str) -> &'a Path {
        self.csv.as_deref().unwrap_or(Path::new(usual))
    }
}

#[derive(Debug, Args)]
pub(super) struct SolverGrowthArguments {
    /// CSV file to write; the charts are written next to it.
    #[arg(long, default_value = "solver-growth.csv")]
    csv: PathBuf,
    /// Number of sizes, from the smallest.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=5))]
    sizes: u8,
    /// Run only this case.
    #[arg(long, hide = true, requires = "timing")]
    case: Option<SlabCase>,
    /// With --case: JSON file for its times and memory.
    #[arg(long, hide = true, requires = "case")]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct ServiceArguments {
    /// CSV file to write; the charts and the memory samples are written next to it.
    #[arg(long, default_value = "service.csv")]
    csv: PathBuf,
    /// URL of a running server [default: start one on a free port of this machine, in a temporary directory].
    #[arg(long)]
    url: Option<String>,
    /// With --url: process id of the server, to sample its memory.
    #[arg(long, requires = "url")]
    pid: Option<u32>,
    /// Duration of the load, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Number of small jobs after the load; with 0 the memory is not measured.
    #[arg(long, default_value_t = 1000)]
    jobs: usize,
    /// Clients that read the status of jobs and sessions.
    #[arg(long, default_value_t = 50)]
    pollers: usize,
    /// Clients that follow the events of jobs.
    #[arg(long, default_value_t = 10)]
    followers: usize,
    /// Number of sessions.
    #[arg(long, default_value_t = 200, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    sessions: usize,
    /// Solves at the same time.
    #[arg(long, default_value_t = 2)]
    solvers: usize,
    /// Pause of a client between two reads, ms.
    #[arg(long, default_value_t = 100)]
    pause_ms: u64,
}

#[derive(Debug, Args)]
pub(super) struct StabilityArguments {
    /// CSV file to write; the map is written next to it.
    #[arg(long, default_value = "stability.csv")]
    csv: PathBuf,
    /// Run only scenes whose name contains this text.
    #[arg(long)]
    only: Option<String>,
}

#[derive(Debug, Args)]
pub(super) struct TruthArguments {
    /// `phantom`, or a folder with `landmarks.json` and a CT (*.nii.gz) or the surfaces skin.* and skull.*.
    #[arg(long, default_value = "phantom")]
    scene: HeadSource,
    /// CSV file to write.
    #[arg(long, default_value = "truth.csv")]
    csv: PathBuf,
    /// Edge length of the prediction's mesh, mm; the mesh of the truth has half of it.
    #[arg(long, default_value_t = 7.0)]
    edge_mm: f64,
    /// Standard deviation of the scan's noise along each axis, mm.
    #[arg(long, default_value_t = 0.3)]
    noise_mm: f64,
    /// Step (1 to 3) whose skin is the prediction; steps before the last differ from the truth by millimetres.
    #[arg(long, default_value_t = 3, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=3))]
    prediction_step: usize,
}

/// Reads a line of a chart, NAME=SECONDS.
fn line(word: &str) -> Result<(String, f64), String> {
    let (name, seconds) = word.rsplit_once('=').ok_or_else(|| format!("{word:?} is not NAME=SECONDS"))?;
    let seconds = seconds.parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0);
    Ok((name.to_owned(), seconds.ok_or_else(|| format!("{word:?} names no positive time"))?))
}

pub(super) fn run(command: &BenchCommand) -> CommandResult {
    let out = &mut std::io::stdout();
    match command {
        BenchCommand::Field(a) => run_field(a, out)?,
        BenchCommand::Bounds(a) => {
            let settings = FieldSettings { spacing_mm: a.spacing_mm, band_mm: a.band_mm, ..FieldSettings::default() };
            if !(BoundStudy { mesh: &a.mesh, settings, most_s: a.most_s }.run(out)?) {
                return Err("an error exceeds its proven bound: see the output".into());
            }
        }
        BenchCommand::Growth(a) => GrowthStudy { mesh: &a.mesh, csv: &a.csv }.run(out)?,
        BenchCommand::Models(a) => match (&a.out, &a.timing, a.scene.as_slice()) {
            (Some(to), Some(timing), [scene]) => run_model_cases(scene, &a.cases, to, timing)?,
            (_, _, sources) => {
                let (csv, edges_mm, lines) = (&a.csv, &a.edges_mm, &a.line);
                ModelStudy { sources, csv, edges_mm, reference_mm: a.reference_mm, lines }.run(out)?;
            }
        },
        BenchCommand::Reach(a) => {
            ReachStudy { source: &a.scene, edge_mm: a.edge_mm, csv: a.csv("reach.csv") }.run(out)?;
        }
        BenchCommand::WarmStart(a) => {
            WarmStartStudy { source: &a.scene, edge_mm: a.edge_mm, csv: a.csv("warm-start.csv") }.run(out)?;
        }
        BenchCommand::SolverGrowth(a) => match (&a.case, &a.timing) {
            (Some(case), Some(timing)) => run_slab_case(case, timing)?,
            _ => SolverGrowthStudy { csv: &a.csv, sizes: usize::from(a.sizes) }.run(out)?,
        },
        BenchCommand::Service(a) => run_service(a, out)?,
        BenchCommand::Proposals(a) => a.run(out)?,
        BenchCommand::Poses(a) => a.run(out)?,
        BenchCommand::Operations(a) => a.run(out)?,
        BenchCommand::Budget(a) => a.run(out)?,
        BenchCommand::Assumptions(a) => a.run(out)?,
        BenchCommand::Ratios(a) => a.run(out)?,
        BenchCommand::Stability(a) => {
            if !(StabilityStudy { csv: &a.csv, only: a.only.as_deref() }.run(out)?) {
                return Err("a result is wrong without a warning: see the rows with the verdict `wrong`".into());
            }
        }
        BenchCommand::Truth(a) => {
            let (edge_mm, noise_mm, prediction_step) = (a.edge_mm, a.noise_mm, a.prediction_step);
            TruthStudy { source: &a.scene, csv: &a.csv, edge_mm, noise_mm, prediction_step }.run(out)?;
        }
        BenchCommand::Cuts(a) => {
            let study = CutStudy {
                skull: &a.skull,
                landmarks: a.landmarks.as_deref(),
                count: a.count,
                seed: a.seed,
                csv: &a.csv,
            };
            if !study.run(out)? {
                return Err("a result is wrong: see the column `wrong`".into());
            }
        }
        BenchCommand::Contacts(a) => ContactStudy { mesh: &a.mesh, csv: &a.csv }.run(out)?,
        BenchCommand::Collision(a) => {
            CollisionStudy { skull: &a.mesh, skin: &a.skin, landmarks: &a.landmarks, csv: &a.csv }.run(out)?;
        }
    }
    Ok(())
}

fn run_field(a: &FieldArguments, out: &mut dyn Write) -> CommandResult {
    match (&a.csv, &a.points, &a.out) {
        (Some(csv), _, _) => {
            FieldStudy { mesh: &a.mesh, csv, full: a.full, openvdb: a.openvdb.as_deref() }.run(out)?;
        }
        (None, Some(points), Some(to)) => {
            evaluate(&a.mesh, &settings(a), points, to, a.timing.as_deref(), &mut std::io::stderr())?;
        }
        (None, _, _) => return Err("no output: give either --csv, or --points and --out".into()),
    }
    Ok(())
}

fn run_service(a: &ServiceArguments, out: &mut dyn Write) -> CommandResult {
    let study = ServiceStudy {
        csv: &a.csv,
        url: a.url.as_deref(),
        pid: a.pid,
        seconds: a.seconds,
        jobs: a.jobs,
        pollers: a.pollers,
        followers: a.followers,
        sessions: a.sessions,
        solvers: a.solvers,
        pause_ms: a.pause_ms,
    };
    if study.run(out)? {
        return Ok(());
    }
    Err("a goal is missed: 99 % of status reads below 50 ms, no errors, memory growth below 5 %".into())
}

fn settings(a: &FieldArguments) -> MethodSettings {
    let defaults = MethodSettings::default();
    MethodSettings {
        method: a.method.into(),
        field: FieldSettings {
            spacing_mm: a.spacing_mm.unwrap_or(defaults.field.spacing_mm),
            band_mm: a.band_mm.unwrap_or(defaults.field.band_mm),
            margin_mm: a.margin_mm.unwrap_or(defaults.field.margin_mm),
        },
        resolution: a.resolution,
        tolerance: a.tolerance.map_or(defaults.tolerance, Tolerance::Relative),
    }
}
