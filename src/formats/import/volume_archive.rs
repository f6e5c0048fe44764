//! Finds the volumes in an archive, and reads one.

use std::io::Read;

use flate2::read::MultiGzDecoder;

use super::archive::{self, Archive};
use super::error::malformed;
use super::volume_detect::{SHOWING, detect_volume};
use super::volume_settings::{VolumeFormat, VolumeRead, VolumeSettings};
use super::{ImportError, Limits, dicom, meta_image, nifti1, nrrd};
use prosopon_geometry::Warning;

/// First bytes of a file in which a list looks for the size of its volume.
const HEADER: u64 = 1 << 16;
/// Most volumes that a refusal lists.
const LISTED: usize = 50;
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// A file that holds a volume, or the header of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Packed {
    /// Index in the archive.
    file: usize,
    format: VolumeFormat,
}

/// Files of an archive by content; `others` counts files that are no images.
#[derive(Default)]
struct Contents {
    images: Vec<(usize, dicom::Header)>,
    volumes: Vec<Packed>,
    others: usize,
}

impl Contents {
    fn of(archive: &mut Archive<'_>) -> Result<Self, ImportError> {
        let mut contents = Self::default();
        for file in 0..archive.len() {
            if archive.name(file).is_none() {
                continue;
            }
            match format_of(archive, file)? {
                Some(VolumeFormat::Dicom) => contents.add_dicom(archive, file)?,
                Some(VolumeFormat::Zip) | None => contents.others = contents.others.saturating_add(1),
                Some(format @ (VolumeFormat::Nifti | VolumeFormat::Nrrd | VolumeFormat::MetaImage)) => {
                    contents.volumes.push(Packed { file, format })
                }
            }
        }
        Ok(contents)
    }

    fn add_dicom(&mut self, archive: &mut Archive<'_>, file: usize) -> Result<(), ImportError> {
        let found = dicom::headers(&archive.read(file, dicom::MAX_FILE)?).map_err(|e| e.in_file(file))?;
        if found.is_empty() {
            self.others = self.others.saturating_add(1);
        }
        self.images.extend(found.into_iter().map(|header| (file, header)));
        Ok(())
    }
}

/// The format of a file; a gzip stream is a NIfTI file only if it begins like one, since it may hold the voxels of a header.
fn format_of(archive: &mut Archive<'_>, file: usize) -> Result<Option<VolumeFormat>, ImportError> {
    let beginning = archive.beginning(file, SHOWING as u64)?;
    if !beginning.starts_with(&GZIP) {
        return Ok(detect_volume(&beginning));
    }
    let packed = archive.beginning(file, HEADER)?;
    let mut unpacked = Vec::new();
    // A stream that is cut off after the header is an error where its voxels are read.
    let _ = MultiGzDecoder::new(packed.as_slice()).take(SHOWING as u64).read_to_end(&mut unpacked);
    Ok(nifti1::is_header(&unpacked).then_some(VolumeFormat::Nifti))
}

/// Reads the DICOM series or the volume of an archive.
///
/// # Errors
/// [`ImportError`]; it lists the volumes when there are several and `settings` choose none.
pub(super) fn read(bytes: &[u8], limits: &Limits, settings: &VolumeSettings) -> Result<VolumeRead, ImportError> {
    let mut archive = Archive::open(bytes, limits)?;
    let Contents { images, volumes, others } = Contents::of(&mut archive)?;
    if images.is_empty() || settings.volume.is_some() {
        let chosen = choose(&mut archive, &volumes, settings.volume)?;
        return packed_volume(&mut archive, chosen, limits, settings);
    }
    let mut warnings = Vec::new();
    if others > 0 {
        warnings.push(Warning::info("files-skipped", format!("{others} files that are not images were skipped")));
    }
    if !volumes.is_empty() {
        let list = list(&mut archive, &volumes)?;
        let found = format!("the archive has DICOM images, which were read, and other volumes: {list}");
        warnings.push(Warning::check("several-volumes", found).act("Send `volume` with the number of another one."));
    }
    let fetch = |index: usize| archive.clone().read(index, dicom::MAX_FILE);
    let found = dicom::assemble(images, &fetch, limits, settings, &mut warnings)?;
    Ok(VolumeRead { volume: found.volume, format: VolumeFormat::Dicom, series: found.series, warnings })
}

/// The requested volume, or the only one.
fn choose(archive: &mut Archive<'_>, volumes: &[Packed], requested: Option<usize>) -> Result<Packed, ImportError> {
    match (volumes, requested) {
        ([], None) => {
            Err(malformed(archive::FORMAT, "the archive holds no DICOM images and no volume of another format"))
        }
        (&[only], None) => Ok(only),
        (_, None) => {
            let detail = format!(
                "the archive holds several volumes, expected one; choose one with `volume`: {}",
                list(archive, volumes)?
            );
            Err(malformed(archive::FORMAT, detail))
        }
        (_, Some(number)) => match number.checked_sub(1).and_then(|at| volumes.get(at)) {
            Some(chosen) => Ok(*chosen),
            None => {
                let list = list(archive, volumes)?;
                let list = if list.is_empty() { "none that is not DICOM".to_owned() } else { list };
                Err(malformed(archive::FORMAT, format!("volume {number} was requested, but the archive has {list}")))
            }
        },
    }
}

/// Describes the volumes by number, place in the archive, format and size, without their names.
fn list(archive: &mut Archive<'_>, volumes: &[Packed]) -> Result<String, ImportError> {
    let mut lines = Vec::new();
    for (at, Packed { file, format }) in volumes.iter().take(LISTED).enumerate() {
        let header = archive.beginning(*file, HEADER)?;
        let extent = match format {
            VolumeFormat::Nifti => nifti1::extent(&header),
            VolumeFormat::Nrrd => nrrd::extent(&header),
            VolumeFormat::MetaImage => meta_image::extent(&header),
            VolumeFormat::Dicom | VolumeFormat::Zip => None,
        };
        let size = extent.map_or_else(String::new, |dims| {
            let dims: Vec<String> = dims.iter().map(usize::to_string).collect();
            format!(", {} voxels", dims.join(" x "))
        });
        let (number, file) = (at.saturating_add(1), file.saturating_add(1));
        lines.push(format!("volume {number}: file {file}, {}{size}", format.name()));
    }
    Ok(lines.join("; "))
}

/// Reads a volume with the voxel files that its header names.
fn packed_volume(
    archive: &mut Archive<'_>,
    Packed { file, format }: Packed,
    limits: &Limits,
    settings: &VolumeSettings,
) -> Result<VolumeRead, ImportError> {
    let at_most = archive::max_unpacked(limits);
    let whole = archive.read(file, at_most)?;
    let mut warnings = Vec::new();
    let volume = if format == VolumeFormat::Nifti && nifti1::is_pair(&whole) {
        let stem = archive.stem(file).unwrap_or_default();
        let beside = [".img", ".img.gz"].iter().find_map(|ending| archive.beside(file, &format!("{stem}{ending}")));
        let Some(beside) = beside else {
            let detail = "the header's voxels are in a file with the ending .img, which is not in the archive";
            return Err(malformed(archive::FORMAT, detail));
        };
        nifti1::read_pair(&whole, &archive.read(beside, at_most)?, limits, settings, &mut warnings)?
    } else {
        let mut fetch = |name: &str| {
            let beside =
                archive.beside(file, name).ok_or("a voxel file that the header names is not in the archive")?;
            archive.read(beside, at_most).map_err(|_| "a voxel file is damaged or too large")
        };
        match format {
            VolumeFormat::Nifti => nifti1::read(&whole, limits, settings, &mut warnings)?,
            VolumeFormat::Nrrd => nrrd::read(&whole, limits, settings, &mut fetch, &mut warnings)?,
            VolumeFormat::MetaImage => meta_image::read(&whole, limits, settings, &mut fetch, &mut warnings)?,
            VolumeFormat::Dicom | VolumeFormat::Zip => {
                return Err(malformed(archive::FORMAT, "an archive in the archive cannot be read"));
            }
        }
    };
    Ok(VolumeRead { volume, format, series: None, warnings })
}
