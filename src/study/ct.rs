//! CT files: reading, conversion, and comparison of their surfaces with given surfaces.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use nalgebra::Matrix3;
use rayon::prelude::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::error::{BenchError, read, write};
use super::files::read_surface;
use prosopon_field::ExactDistance;
use prosopon_formats::export::{SurfaceView, nifti_gz, ply};
use prosopon_formats::import::{ImportError, Limits, VolumeRead, VolumeSettings, volume_with};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Point, TriMesh, Volume};
use prosopon_planning::surface::{CtSettings, from_ct};

/// Largest number of files in a folder that is read as a series.
const MAX_FILES: usize = 20_000;

/// Endings of headers that name their voxel files, and of such files.
const NAMED: [&str; 7] = ["mhd", "nhdr", "hdr", "raw", "zraw", "gz", "img"];

/// Reads the bytes of a CT: a file as it is, a folder with all its subfolders as a zip archive.
///
/// In the archive, files have numbers instead of names, because names of DICOM files may contain a patient's name. MetaImage,
/// NRRD and NIfTI files whose header names its voxel file keep their names.
///
/// # Errors
/// [`BenchError::File`] when a file cannot be read or the folder has more than 20 000 files.
pub fn read_ct(path: &Path) -> Result<Vec<u8>, BenchError> {
    if !path.is_dir() {
        return read(path);
    }
    let fault = |source| BenchError::File { what: "read", path: path.to_owned(), source };
    let mut files = Vec::new();
    list(path, &mut files).map_err(fault)?;
    files.sort();
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    // Compression would take longer than the upload to a service on this machine.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (number, file) in files.iter().enumerate() {
        // Names of DICOM files may contain a patient's name.
        let kept = file.extension().and_then(|e| e.to_str()).filter(|e| NAMED.contains(e));
        let name = match (kept, file.file_name().and_then(|n| n.to_str())) {
            (Some(_), Some(name)) => name.to_owned(),
            _ => number.to_string(),
        };
        archive.start_file(name, options).map_err(|e| fault(e.into()))?;
        archive.write_all(&read(file)?).map_err(fault)?;
    }
    Ok(archive.finish().map_err(|e| fault(e.into()))?.into_inner())
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_dir() {
            list(&entry.path(), files)?;
        } else if kind.is_file() {
            files.push(entry.path());
        }
        if files.len() > MAX_FILES {
            return Err(std::io::Error::other(format!("more than {MAX_FILES} files")));
        }
    }
    Ok(())
}

/// Reads a CT of any supported format from a file or folder.
///
/// # Errors
/// [`BenchError::File`] when a file cannot be read, [`BenchError::Volume`] when its content is not a CT.
pub fn load_ct(path: &Path, settings: &VolumeSettings) -> Result<VolumeRead, BenchError> {
    let refused = |source: ImportError| BenchError::Volume { path: path.to_owned(), source };
    volume_with(&read_ct(path)?, &Limits::default(), settings).map_err(refused)
}

/// The command `prosopon ct convert`.
#[derive(Debug, Clone)]
pub struct CtConversion {
    /// The CT, a file or folder.
    pub input: PathBuf,
    /// NIfTI file to write.
    pub out: Option<PathBuf>,
    /// Another CT to compare with.
    pub compare: Option<PathBuf>,
    /// Settings for reading `input`.
    pub settings: VolumeSettings,
}

impl CtConversion {
    /// Reads the CT, describes it on `out`, and writes and compares it as configured.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        let begin = Instant::now();
        let found = load_ct(&self.input, &self.settings)?;
        let volume = &found.volume;
        let steps = volume.axes.map(|a| format!("{:.4}", a.norm())).join(" x ");
        let [i, j, k] = volume.axes.map(|a| a.normalize());
        writeln!(
            out,
            "{}: {:?} voxels of {steps} mm, read in {:.2} s",
            found.format.name(),
            volume.dims,
            begin.elapsed().as_secs_f64()
        )?;
        writeln!(out, "origin (LPS mm): {:.4} {:.4} {:.4}", volume.origin.x, volume.origin.y, volume.origin.z)?;
        for (name, axis) in [("i", i), ("j", j), ("k", k)] {
            writeln!(out, "direction of {name} (LPS): {:.6} {:.6} {:.6}", axis.x, axis.y, axis.z)?;
        }
        if let (Some(low), Some(high)) = (volume.hu.iter().min(), volume.hu.iter().max()) {
            writeln!(out, "{low} to {high} HU")?;
        }
        for warning in &found.warnings {
            writeln!(out, "warning: {warning}")?;
        }
        if let Some(path) = &self.out {
            let packed = nifti_gz(volume).map_err(|e| BenchError::File {
                what: "write",
                path: path.clone(),
                source: std::io::Error::other(e),
            })?;
            write(path, &packed)?;
        }
        if let Some(path) = &self.compare {
            let reference = load_ct(path, &VolumeSettings { any_modality: true, ..VolumeSettings::default() })?;
            let Difference { n, equal, max, mean } = difference(volume, &reference.volume);
            writeln!(
                out,
                "compared at {n} of {} voxels: {equal} equal, mean difference {mean:.4} HU, largest {max:.3} HU",
                volume.hu.len()
            )?;
        }
        Ok(())
    }
}

/// Absolute differences at the voxels of one volume that lie inside another, HU.
struct Difference {
    n: usize,
    equal: usize,
    max: f64,
    mean: f64,
}

/// Compares each voxel with the trilinear value of `reference` at the same position.
fn difference(volume: &Volume, reference: &Volume) -> Difference {
    let index_from_mm = Matrix3::from_columns(&reference.axes).try_inverse().unwrap_or_else(Matrix3::identity);
    let mut found = Difference { n: 0, equal: 0, max: 0.0, mean: 0.0 };
    let [nx, ny, _] = volume.dims;
    for (at, hu) in volume.hu.iter().enumerate() {
        let [i, j, k] = [at % nx, at / nx % ny, at / nx / ny].map(|c| c as f64);
        let place = volume.origin + volume.axes[0] * i + volume.axes[1] * j + volume.axes[2] * k;
        // Headers round positions to about a thousandth of a voxel.
        let index = (index_from_mm * (place - reference.origin))
            .map(|c| if (c - c.round()).abs() < 1e-3 { c.round() } else { c });
        if let Some(expected) = trilinear(reference, [index.x, index.y, index.z]) {
            let off = (expected - f64::from(*hu)).abs();
            found.n += 1;
            found.equal += usize::from(off == 0.0);
            found.max = found.max.max(off);
            found.mean += off;
        }
    }
    found.mean /= found.n.max(1) as f64;
    found
}

fn trilinear(volume: &Volume, index: [f64; 3]) -> Option<f64> {
    let inside = |a: usize| (0.0..=volume.dims[a] as f64 - 1.0).contains(&index[a]);
    if !(0..3).all(inside) {
        return None;
    }
    let base: [usize; 3] = std::array::from_fn(|a| (index[a] as usize).min(volume.dims[a].saturating_sub(2)));
    let mut sum = 0.0;
    for corner in 0..8usize {
        let step = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
        let weight: f64 = (0..3).map(|a| (1.0 - step[a] as f64 - (index[a] - base[a] as f64)).abs()).product();
        if weight > 0.0 {
            let [i, j, k] = [0, 1, 2].map(|a| base[a] + step[a]);
            sum += weight * f64::from(volume.hu[i + volume.dims[0] * (j + volume.dims[1] * k)]);
        }
    }
    Some(sum)
}

/// The command `prosopon ct surfaces`.
#[derive(Debug, Clone)]
pub struct CtSurfaceStudy {
    /// The CT, a file or folder.
    pub input: PathBuf,
    /// Folder for skin, skull and air as PLY files.
    pub out: Option<PathBuf>,
    /// Skin surface to compare with.
    pub skin: Option<PathBuf>,
    /// Skull surface to compare with.
    pub skull: Option<PathBuf>,
    /// Only points in this box are compared, LPS mm.
    pub within: Option<Aabb>,
    /// HU levels and tolerance of the surfaces.
    pub settings: CtSettings,
    /// Settings for reading `input`.
    pub reading: VolumeSettings,
}

impl CtSurfaceStudy {
    /// Extracts the surfaces as the service does and compares them with the given ones.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        let found = load_ct(&self.input, &self.reading)?;
        let begin = Instant::now();
        let surfaces = from_ct(&found.volume, &self.settings, &Control::new())
            .map_err(|source| BenchError::Ct { path: self.input.clone(), source })?;
        writeln!(out, "surfaces in {:.1} s", begin.elapsed().as_secs_f64())?;
        for warning in found.warnings.iter().chain(&surfaces.warnings) {
            writeln!(out, "warning: {warning}")?;
        }
        let parts = [("skin", Some(&surfaces.skin)), ("skull", Some(&surfaces.skull)), ("air", surfaces.air.as_ref())];
        for (name, mesh) in parts.into_iter().filter_map(|(name, mesh)| Some((name, mesh?))) {
            let cm3 = mesh.volume() / 1e3;
            writeln!(out, "{name}: {} triangles, {cm3:.1} cm3", mesh.triangles().len())?;
            if let Some(folder) = &self.out {
                let path = folder.join(format!("{name}.ply"));
                write(&path, &ply(&SurfaceView { mesh, scalars: &[], colours: None }))?;
            }
        }
        for (name, mesh, given) in [("skin", &surfaces.skin, &self.skin), ("skull", &surfaces.skull, &self.skull)] {
            let Some(path) = given else { continue };
            let given = read_surface(path)?;
            let [ours, theirs] = [(mesh, &given), (&given, mesh)].map(|(a, b)| self.distances(a, b));
            writeln!(
                out,
                "{name}, extracted to given: {ours}; given to extracted: {theirs}; symmetric mean {:.3} mm",
                0.5 * (ours.mean + theirs.mean)
            )?;
        }
        Ok(())
    }

    /// Distances from the centroids of the triangles of `a` to `b`, weighted by area.
    fn distances(&self, a: &TriMesh, b: &TriMesh) -> Spread {
        let exact = ExactDistance::new(b);
        let mut found: Vec<(f64, f64)> = (0..a.triangles().len())
            .into_par_iter()
            .filter_map(|t| {
                let [p, q, r] = a.corners(t);
                let middle = Point::from((p.coords + q.coords + r.coords) / 3.0);
                let counts = self.within.is_none_or(|b| (0..3).all(|i| (b.min[i]..=b.max[i]).contains(&middle[i])));
                counts.then(|| (exact.closest(&middle).2.abs(), 0.5 * a.scaled_normal(t).norm()))
            })
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let area: f64 = found.iter().map(|f| f.1).sum();
        let mut below = 0.0;
        let p95 = found.iter().find(|f| {
            below += f.1;
            below >= 0.95 * area
        });
        Spread {
            mean: found.iter().map(|f| f.0 * f.1).sum::<f64>() / area,
            p95: p95.map_or(0.0, |f| f.0),
            max: found.last().map_or(0.0, |f| f.0),
        }
    }
}

/// Statistics of the distances over a surface, mm.
#[derive(Debug, Clone, Copy)]
struct Spread {
    mean: f64,
    p95: f64,
    max: f64,
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mean {:.3}, P95 {:.3}, max {:.2} mm", self.mean, self.p95, self.max)
    }
}
