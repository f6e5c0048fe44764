use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::{CommandResult, refuse_overwriting};
use prosopon_formats::import::{SeriesChoice, VolumeSettings};
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::surface::CtSettings;
use prosopon_study::{CtConversion, CtSurfaceStudy};

/// Subcommands of `prosopon ct`.
#[derive(Debug, Subcommand)]
pub(super) enum CtCommand {
    /// Read and describe a CT as the service does; write it as NIfTI or compare it with another one.
    Convert(ConvertArguments),
    /// Extract skin, skull and air from a CT as the service does, and compare them with given surfaces.
    Surfaces(SurfaceArguments),
}

/// Input of `prosopon ct` and how to read it.
#[derive(Debug, Args)]
struct InputArguments {
    /// CT: DICOM series (zip or folder), NIfTI, NRRD, MetaImage.
    input: PathBuf,
    #[command(flatten)]
    reading: ReadArguments,
}

/// How to read a CT.
#[derive(Debug, Args)]
pub(super) struct ReadArguments {
    /// DICOM series to read: its SeriesInstanceUID, or its number in the list of the warning about several series.
    #[arg(long)]
    series: Option<String>,
    /// Stack to read of a series or file with several (acquisitions, time points, phases), by its number in the refusal's list.
    #[arg(long)]
    stack: Option<usize>,
    /// Volume to read of an archive with several, by its number in the refusal's list.
    #[arg(long)]
    volume: Option<usize>,
    /// HU per stored number, instead of what the file says.
    #[arg(long)]
    rescale_slope: Option<f64>,
    /// HU of the stored number zero, instead of what the file says.
    #[arg(long, allow_negative_numbers = true)]
    rescale_intercept: Option<f64>,
    /// Also accept DICOM series of other modalities than CT.
    #[arg(long)]
    any_modality: bool,
    /// Largest gap between unevenly spaced slices that is interpolated, mm.
    #[arg(long, default_value_t = VolumeSettings::default().max_step_mm)]
    max_step_mm: f64,
}

impl ReadArguments {
    pub(super) fn settings(&self) -> VolumeSettings {
        VolumeSettings {
            series: self.series.as_deref().map(SeriesChoice::of),
            stack: self.stack,
            volume: self.volume,
            rescale_slope: self.rescale_slope,
            rescale_intercept: self.rescale_intercept,
            any_modality: self.any_modality,
            max_step_mm: self.max_step_mm,
        }
    }
}

#[derive(Debug, Args)]
pub(super) struct ConvertArguments {
    #[command(flatten)]
    read: InputArguments,
    /// NIfTI file to write (.nii.gz).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Another CT of the same anatomy; each voxel is compared with its value at the same position.
    #[arg(long)]
    compare: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(super) struct SurfaceArguments {
    #[command(flatten)]
    read: InputArguments,
    /// Folder to write the surfaces to, as PLY.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Skin surface to compare with.
    #[arg(long)]
    skin: Option<PathBuf>,
    /// Skull surface to compare with.
    #[arg(long)]
    skull: Option<PathBuf>,
    /// Compare only within this box: smallest x, y, z and largest x, y, z, LPS mm.
    #[arg(long, num_args = 6, allow_negative_numbers = true, value_names = ["X0", "Y0", "Z0", "X1", "Y1", "Z1"])]
    within: Option<Vec<f64>>,
    /// Level of the skin surface in the volume's own values; -300 HU or what corresponds to it when absent.
    #[arg(long, allow_negative_numbers = true)]
    skin_hu: Option<f64>,
    /// Level of the bone surface in the volume's own values; 300 HU or what corresponds to it when absent.
    #[arg(long, allow_negative_numbers = true)]
    bone_hu: Option<f64>,
}

pub(super) fn run(command: &CtCommand) -> CommandResult {
    let mut out = std::io::stdout();
    match command {
        CtCommand::Convert(ConvertArguments { read, out: file, compare }) => {
            let settings = read.reading.settings();
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
                reading: read.reading.settings(),
            };
            study.run(&mut out)?;
        }
    }
    Ok(())
}
