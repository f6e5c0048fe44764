use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::CommandResult;
use crate::bench::{CollisionStudy, ContactStudy, FieldStudy, evaluate};
use crate::field::{FieldSettings, Method, MethodSettings, Tolerance};

/// Studies of `prosopon bench`.
#[derive(Debug, Subcommand)]
pub(super) enum BenchCommand {
    /// Distance fields: time, memory and error of every builder; or the values of one at given points.
    Field(FieldArguments),
    /// Collision detection along a path: time against tolerance.
    Collision(CollisionArguments),
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
pub(super) struct CollisionArguments {
    /// Surface of the moved bone.
    #[arg(long)]
    mesh: PathBuf,
    /// Surface of the tissue, for example the skin.
    #[arg(long)]
    tissue: PathBuf,
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

pub(super) fn run(command: &BenchCommand) -> CommandResult {
    let out = &mut std::io::stdout();
    match command {
        BenchCommand::Field(a) => match (&a.csv, &a.points, &a.out) {
            (Some(csv), _, _) => FieldStudy { mesh: &a.mesh, csv, full: a.full }.run(out)?,
            (None, Some(points), Some(to)) => evaluate(&a.mesh, &settings(a), points, to, a.timing.as_deref())?,
            (None, _, _) => return Err("give either --csv, or --points and --out".into()),
        },
        BenchCommand::Contacts(a) => ContactStudy { mesh: &a.mesh, csv: &a.csv }.run(out)?,
        BenchCommand::Collision(a) => {
            CollisionStudy { mesh: &a.mesh, tissue: &a.tissue, csv: &a.csv }.run(out)?;
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
