use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::{CommandResult, refuse_overwriting};
use prosopon_formats::import::{SeriesChoice, VolumeSettings};
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::surface::CtSettings;
use prosopon_study::{CtConversion, CtSurfaceStudy};

/// What `prosopon ct` does.
#[derive(Debug, Subcommand)]
pub(super) enum CtCommand {
    /// Read a CT as the service does, say what it is, and write it as NIfTI; or hold it against another.
    Convert(ConvertArguments),
    /// Take skin, skull and air from a CT as the service does, and hold them against given surfaces.
    Surfaces(SurfaceArguments),
}

/// How a CT is read.
#[derive(Debug, Args)]
struct ReadArguments {
    /// CT: DICOM series (zip or folder), NIfTI, NRRD, MetaImage.
    input: PathBuf,
    /// Of several DICOM series, this one: SeriesInstanceUID, or number as a warning lists them.
    #[arg(long)]
    series: Option<String>,
    /// Series of other modalities than CT too.
    #[arg(long)]
    any_modality: bool,
    /// Largest gap between slices that is interpolated when they are uneven, mm.
    #[arg(long, default_value_t = VolumeSettings::default().max_step_mm)]
    max_step_mm: f64,
}

impl ReadArguments {
    fn settings(&self) -> VolumeSettings {
        VolumeSettings {
            series: self.series.as_deref().map(SeriesChoice::of),
            any_modality: self.any_modality,
            max_step_mm: self.max_step_mm,
        }
    }
}

#[derive(Debug, Args)]
pub(super) struct ConvertArguments {
    #[command(flatten)]
    read: ReadArguments,
    /// NIfTI goes here (.nii.gz).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Another CT of the same anatomy; each voxel is held against its value in the same place.
    #[arg(long)]
    compare: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct SurfaceArguments {
    #[command(flatten)]
    read: ReadArguments,
    /// Folder for the surfaces, PLY.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Given skin to compare with.
    #[arg(long)]
    skin: Option<PathBuf>,
    /// Given skull to compare with.
    #[arg(long)]
    skull: Option<PathBuf>,
    /// Compare within this box only: least x, y, z and largest x, y, z, LPS mm.
    #[arg(long, num_args = 6, allow_negative_numbers = true, value_names = ["X0", "Y0", "Z0", "X1", "Y1", "Z1"])]
    within: Option<Vec<f64>>,
    /// Skin level, HU.
    #[arg(long, default_value_t = CtSettings::default().skin_hu, allow_negative_numbers = true)]
    skin_hu: f64,
    /// Bone level, HU.
    #[arg(long, default_value_t = CtSettings::default().bone_hu)]
    bone_hu: f64,
}

pub(super) fn run(command: &CtCommand) -> CommandResult {
    let mut out = std::io::stdout();
    match command {
        CtCommand::Convert(ConvertArguments { read, out: file, compare }) => {
            let settings = read.settings();
            if let Some(file) = file {
                refuse_overwriting(
                    file,
                    &[Some(&read.input), compare.as_ref()].map(|p| p.cloned().unwrap_or_default()),
                )?;
            }
            let conversion =
                CtConversion { input: read.input.clone(), out: file.clone(), compare: compare.clone(), settings };
            conversion.run(&mut out)?;
        }
        CtCommand::Surfaces(arguments) => {
            let SurfaceArguments { read, out: folder, skin, skull, within, skin_hu, bone_hu } = arguments;
            if let Some(folder) = folder {
                std::fs::create_dir_all(folder)?;
            }
            let within = within.as_deref().and_then(|b| match *b {
                [x0, y0, z0, x1, y1, z1] => Some(Aabb { min: Point::new(x0, y0, z0), max: Point::new(x1, y1, z1) }),
                _ => None,
            });
            let study = CtSurfaceStudy {
                input: read.input.clone(),
                out: folder.clone(),
                skin: skin.clone(),
                skull: skull.clone(),
                within,
                settings: CtSettings { skin_hu: *skin_hu, bone_hu: *bone_hu, ..CtSettings::default() },
                reading: read.settings(),
            };
            study.run(&mut out)?;
        }
    }
    Ok(())
}
