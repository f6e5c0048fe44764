use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};

use super::CommandResult;
use prosopon_field::{FieldSettings, Method, MethodSettings, Tolerance};
use prosopon_study::{
    BoundStudy, CollisionStudy, ContactStudy, CutStudy, FieldStudy, GrowthStudy, HeadSource, ModelCase, ModelStudy,
    OperationStudy, ProposalStudy, ReachStudy, ServiceStudy, SlabCase, SolverGrowthStudy, StabilityStudy, TruthStudy,
    WarmStartStudy, evaluate, run_model_cases, run_slab_case,
};

/// Studies of `prosopon bench`.
#[derive(Debug, Subcommand)]
pub(super) enum BenchCommand {
    /// Distance fields: time, memory and error of every builder; or the values of one at given points.
    Field(FieldArguments),
    /// Bounds on the adaptive field's error that are proven, and a million points that try to break them.
    Bounds(BoundArguments),
    /// Time to build a field against the number of triangles, 12 000 to a million.
    Growth(GrowthArguments),
    /// Collision detection along a path: time against tolerance.
    Collision(CollisionArguments),
    /// Time and error of every mechanical model on several meshes of one head, against a refined reference.
    Models(ModelArguments),
    /// Forty operations on several heads: how many end in an equilibrium to rely on, and how long they take.
    Operations(OperationArguments),
    /// Landmarks proposed from the surfaces, against known ones.
    Proposals(ProposalArguments),
    /// What leaving out tissue that a plan hardly moves saves, and what it costs.
    Reach(ReachArguments),
    /// What a session's next job takes when it begins at the end of the one before.
    WarmStart(ReachArguments),
    /// The solver's time by phase on a slab of 19 000 to 490 000 tetrahedra.
    SolverGrowth(SolverGrowthArguments),
    /// Registration and error map against a synthetic truth: a finer model's skin, scanned with noise and out of place.
    Truth(TruthArguments),
    /// Every mechanical model on scenes that are hard to solve, each answer checked.
    Stability(StabilityArguments),
    /// The service under load: what status reads take, and its memory over a thousand small jobs.
    Service(ServiceArguments),
    /// Random cuts and paths on a skull: each parts the bone rightly or says why not.
    Cuts(CutArguments),
    /// Newton's method on 20 000 points that a penalty pushes out of bone: share that converges, for each kind of field.
    Contacts(ContactArguments),
}

/// A builder, by name.
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
    /// Surface: STL, PLY or OBJ, mm.
    #[arg(long)]
    mesh: PathBuf,
    /// Study all builders; rows go here and charts beside it.
    #[arg(long, required_unless_present = "points", conflicts_with = "points")]
    csv: Option<PathBuf>,
    /// With --csv: all six settings of the paper's Table 3, not just the four coarser ones.
    #[arg(long, requires = "csv")]
    full: bool,
    /// With --csv: a program that builds a level set with OpenVDB, measured beside the builders (`tests/bench/openvdb.cpp`).
    #[arg(long, requires = "csv")]
    openvdb: Option<PathBuf>,
    /// Evaluate these points: their number as u64, then x, y, z of each as f64, little-endian, mm.
    #[arg(long, requires = "out")]
    points: Option<PathBuf>,
    /// With --points: the distances go here, f64, little-endian, no header.
    #[arg(long, requires = "points")]
    out: Option<PathBuf>,
    /// With --points: the builder.
    #[arg(long, value_enum, default_value = "adaptive", requires = "points")]
    method: MethodName,
    /// With --points: finest spacing, mm.
    #[arg(long, requires = "points", conflicts_with = "resolution")]
    spacing_mm: Option<f64>,
    /// With --points: cells along the edge of the bounding cube.
    #[arg(long, requires = "points")]
    resolution: Option<u32>,
    /// With --points: tolerance of frisken and hybrid, as a share of the bounding cube's edge.
    #[arg(long, requires = "points")]
    tolerance: Option<f64>,
    /// With --points: half-width of the band with full accuracy, mm.
    #[arg(long, requires = "points")]
    band_mm: Option<f64>,
    /// With --points: how far the grid reaches beyond the surface, mm.
    #[arg(long, requires = "points")]
    margin_mm: Option<f64>,
    /// What the build and the queries took, JSON.
    #[arg(long, requires = "points", hide = true)]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct BoundArguments {
    /// Surface: STL, PLY or OBJ, mm; closed.
    #[arg(long)]
    mesh: PathBuf,
    /// Finest spacing, mm.
    #[arg(long, default_value_t = FieldSettings::default().spacing_mm)]
    spacing_mm: f64,
    /// Half-width of the band, mm.
    #[arg(long, default_value_t = FieldSettings::default().band_mm)]
    band_mm: f64,
    /// Most time for the proof in the band, s; how much of the band it covers is told.
    #[arg(long, default_value_t = 120.0)]
    most_s: f64,
}

#[derive(Debug, Args)]
pub(super) struct GrowthArguments {
    /// Surface: STL, PLY or OBJ, mm; it is made coarser and finer.
    #[arg(long)]
    mesh: PathBuf,
    /// Rows go here, the chart beside it.
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
    /// Rows go here, the chart beside it.
    #[arg(long)]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct ContactArguments {
    /// Surface of bone.
    #[arg(long)]
    mesh: PathBuf,
    /// Rows go here.
    #[arg(long)]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct CutArguments {
    /// Surface of the skull: STL, PLY or OBJ, mm.
    #[arg(long)]
    skull: PathBuf,
    /// JSON with `landmarks`, `midline_x_mm`, `occlusal_plane_z_mm`, `le_fort_1_plane`: templates are tried too.
    #[arg(long)]
    landmarks: Option<PathBuf>,
    /// Cuts, and as many paths.
    #[arg(long, default_value_t = 100)]
    count: usize,
    /// Seed of all of them.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Rows go here.
    #[arg(long, default_value = "cuts.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct ModelArguments {
    /// `phantom`, or a folder with `landmarks.json` and a CT (*.nii.gz) or the surfaces skin.* and skull.*.
    #[arg(long)]
    scene: HeadSource,
    /// Rows go here, the chart beside it.
    #[arg(long, default_value = "models.csv")]
    csv: PathBuf,
    /// Edges of the meshes, mm.
    #[arg(long, value_delimiter = ',', default_value = "7,5.5,4")]
    edges_mm: Vec<f64>,
    /// Edge of the reference's mesh, mm.
    #[arg(long, default_value_t = 3.0)]
    reference_mm: f64,
    /// Some cases of one mesh alone.
    #[arg(long, hide = true, value_delimiter = ',', requires = "out", requires = "timing")]
    cases: Vec<ModelCase>,
    /// With --cases: displacements go here.
    #[arg(long, hide = true, requires = "cases")]
    out: Option<PathBuf>,
    /// With --cases: what they took, JSON.
    #[arg(long, hide = true, requires = "cases")]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct ProposalArguments {
    /// Heads, as for `operations`.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
}

#[derive(Debug, Args)]
pub(super) struct OperationArguments {
    /// Heads: `phantom`, `phantom-long`, `phantom-narrow`, or folders as for `models`, whose landmarks are proposed where they are absent.
    #[arg(long, value_delimiter = ',', default_value = "phantom,phantom-long,phantom-narrow")]
    heads: Vec<HeadSource>,
    /// Models as model:locking:edge.
    #[arg(long, value_delimiter = ',', default_value = "mixed:none:4")]
    cases: Vec<ModelCase>,
    /// Operations whose name has this in it, alone.
    #[arg(long)]
    only: Option<String>,
    /// A solve is given up after this long, s.
    #[arg(long, default_value_t = 180.0)]
    limit_s: f64,
    /// Rows go here, the picture beside it.
    #[arg(long, default_value = "operations.csv")]
    csv: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct ReachArguments {
    /// `phantom`, or a folder as for `models`.
    #[arg(long)]
    scene: HeadSource,
    /// Edge of the mesh, mm.
    #[arg(long, default_value_t = 4.0)]
    edge_mm: f64,
    /// Rows go here; `reach.csv` or `warm-start.csv` when absent.
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
    /// Rows go here, the charts beside it.
    #[arg(long, default_value = "solver-growth.csv")]
    csv: PathBuf,
    /// Sizes, from the smallest.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=5))]
    sizes: u8,
    /// One case alone.
    #[arg(long, hide = true, requires = "timing")]
    case: Option<SlabCase>,
    /// With --case: what it took, JSON.
    #[arg(long, hide = true, requires = "case")]
    timing: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct ServiceArguments {
    /// Rows go here, the charts and the memory's rows beside it.
    #[arg(long, default_value = "service.csv")]
    csv: PathBuf,
    /// A server that runs already; else one is started on a free port of this machine, in a temporary directory.
    #[arg(long)]
    url: Option<String>,
    /// With --url: its process, for its memory.
    #[arg(long, requires = "url")]
    pid: Option<u32>,
    /// How long the load lasts, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Small jobs after it.
    #[arg(long, default_value_t = 1000)]
    jobs: usize,
    /// Clients that read how things stand.
    #[arg(long, default_value_t = 50)]
    pollers: usize,
    /// Clients that follow the events of jobs.
    #[arg(long, default_value_t = 10)]
    followers: usize,
    /// Sessions that are listed.
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
    /// Rows go here, the map beside it.
    #[arg(long, default_value = "stability.csv")]
    csv: PathBuf,
    /// Only scenes whose names contain this.
    #[arg(long)]
    only: Option<String>,
}

#[derive(Debug, Args)]
pub(super) struct TruthArguments {
    /// `phantom`, or a folder with `landmarks.json` and a CT (*.nii.gz) or the surfaces skin.* and skull.*.
    #[arg(long, default_value = "phantom")]
    scene: HeadSource,
    /// Rows go here.
    #[arg(long, default_value = "truth.csv")]
    csv: PathBuf,
    /// Edge of the prediction's mesh, mm; the truth's is half of it.
    #[arg(long, default_value_t = 7.0)]
    edge_mm: f64,
    /// Standard deviation of the scan's noise along each axis, mm.
    #[arg(long, default_value_t = 0.3)]
    noise_mm: f64,
    /// The prediction is that of this step of three: before the last it falls short of the truth by millimetres.
    #[arg(long, default_value_t = 3, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=3))]
    prediction_step: usize,
}

pub(super) fn run(command: &BenchCommand) -> CommandResult {
    let out = &mut std::io::stdout();
    match command {
        BenchCommand::Field(a) => match (&a.csv, &a.points, &a.out) {
            (Some(csv), _, _) => {
                FieldStudy { mesh: &a.mesh, csv, full: a.full, openvdb: a.openvdb.as_deref() }.run(out)?;
            }
            (None, Some(points), Some(to)) => {
                evaluate(&a.mesh, &settings(a), points, to, a.timing.as_deref(), &mut std::io::stderr())?;
            }
            (None, _, _) => return Err("give either --csv, or --points and --out".into()),
        },
        BenchCommand::Bounds(a) => {
            let settings = FieldSettings { spacing_mm: a.spacing_mm, band_mm: a.band_mm, ..FieldSettings::default() };
            if !(BoundStudy { mesh: &a.mesh, settings, most_s: a.most_s }.run(out)?) {
                return Err("a point breaks a bound".into());
            }
        }
        BenchCommand::Growth(a) => GrowthStudy { mesh: &a.mesh, csv: &a.csv }.run(out)?,
        BenchCommand::Models(a) => match (&a.out, &a.timing) {
            (Some(to), Some(timing)) => run_model_cases(&a.scene, &a.cases, to, timing)?,
            _ => ModelStudy { source: &a.scene, csv: &a.csv, edges_mm: &a.edges_mm, reference_mm: a.reference_mm }
                .run(out)?,
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
        BenchCommand::Service(a) => {
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
            if !study.run(out)? {
                return Err(
                    "a goal is missed: status reads below 50 ms (99 %), no errors, memory that does not grow".into()
                );
            }
        }
        BenchCommand::Proposals(a) => ProposalStudy { heads: &a.heads }.run(out)?,
        BenchCommand::Operations(a) => {
            let (only, limit_s) = (a.only.as_deref(), a.limit_s);
            if !(OperationStudy { heads: &a.heads, cases: &a.cases, only, limit_s, csv: &a.csv }.run(out)?) {
                return Err("a goal is missed: 97 % to rely on, the slowest within 60 s, the median within 10 s".into());
            }
        }
        BenchCommand::Stability(a) => {
            if !(StabilityStudy { csv: &a.csv, only: a.only.as_deref() }.run(out)?) {
                return Err("an answer is wrong and does not say so: see the rows `wrong`".into());
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
                return Err("an answer is wrong: see the column `wrong`".into());
            }
        }
        BenchCommand::Contacts(a) => ContactStudy { mesh: &a.mesh, csv: &a.csv }.run(out)?,
        BenchCommand::Collision(a) => {
            CollisionStudy { skull: &a.mesh, skin: &a.skin, landmarks: &a.landmarks, csv: &a.csv }.run(out)?;
        }
    }
    Ok(())
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
