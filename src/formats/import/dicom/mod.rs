//! Reads a DICOM series: images in an archive, in any order and encoding, to one volume.
//!
//! The project has its own parser, because the crate `dicom-parser` allocates up to 4 GB for an element whose length the
//! file only states, and decodes and keeps every tag. Here a value is a slice of the file, only the tags named in `header`
//! are read, and no patient data are ever decoded. Crates decode JPEG, JPEG-LS and JPEG 2000; RLE is decoded here.

mod decimals;
mod elements;
mod header;
mod image;
mod labels;
mod phases;
mod pixels;
mod rle;
mod series;
mod stack;
mod stream;
mod syntax;
#[cfg(test)]
pub(super) mod tests;

use std::borrow::Cow;

use rayon::prelude::*;

use super::error::{at_most, malformed};
use super::hounsfield::{AIR, Scale};
use super::lattice::VoxelLattice;
use super::volume_settings::VolumeSettings;
use super::{ImportError, Limits};
use elements::DataSet;
pub(super) use header::Header;
use header::{Images, Rescale};
use image::Image;
use pixels::DecodedImage;
use prosopon_geometry::{Volume, Warning};
use stack::StackLayout;

pub(super) const FORMAT: &str = "DICOM";
/// Most bytes of one file; enough for an enhanced image with 480 frames of 512 × 512 pixels.
pub(super) const MAX_FILE: u64 = 256 << 20;
/// Most pixels of one image.
const MAX_PIXELS: usize = 4096 * 4096;

/// Whether these may be the bytes of a DICOM file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    elements::looks_like(bytes)
}

/// The images of a file, one per frame; empty for files without an image (reports, directories).
pub(super) fn headers(bytes: &[u8]) -> Result<Vec<Header>, ImportError> {
    let set = DataSet::open(bytes)?;
    let found = header::read(&set)?.map_or_else(Vec::new, |images| images.headers);
    match found.first() {
        Some(h) if h.columns.saturating_mul(h.rows) > MAX_PIXELS => {
            Err(malformed(FORMAT, format!("{} x {} pixels, but at most {MAX_PIXELS} are allowed", h.columns, h.rows)))
        }
        _ => Ok(found),
    }
}

/// A volume made of a series.
#[derive(Debug)]
pub(super) struct Assembled {
    pub(super) volume: Volume,
    /// Number of the series that was read, from 1, when there are several.
    pub(super) series: Option<usize>,
}

/// Makes a volume of the images; `fetch` returns the bytes of a file, by its index.
pub(super) fn assemble(
    found: Vec<(usize, Header)>,
    fetch: &(dyn Fn(usize) -> Result<Vec<u8>, ImportError> + Sync),
    limits: &Limits,
    settings: &VolumeSettings,
    warnings: &mut Vec<Warning>,
) -> Result<Assembled, ImportError> {
    let mut stack = series::choose(found, settings, warnings)?;
    let mut images = std::mem::take(&mut stack.images);
    if settings.rescale_slope.is_none() && settings.rescale_intercept.is_none() {
        check_rescale(&images)?;
        warn_of_rescale(&images, warnings);
    }
    for image in &mut images {
        let encoding = &mut image.header.encoding;
        (encoding.slope, encoding.intercept) = settings.rescale(encoding.slope, encoding.intercept);
    }
    warn_of_commas(&images, warnings);
    let advised = |error: ImportError| match &stack.several {
        Some(list) => error.adding(&format!("; the series has several stacks, choose one with `stack`: {list}")),
        None => error,
    };
    let layout = stack::layout(&images, settings.max_step_mm, warnings).map_err(advised)?;
    warnings.extend(stack::gaps(&images, &layout, stack.several.is_none() && settings.stack.is_none()));
    let Some(Image { header, plane, .. }) = images.first() else {
        return Err(malformed(FORMAT, "there are no images"));
    };
    if let Some((image, code)) = images.iter().find_map(|i| match i.header.syntax.pixels {
        syntax::Pixels::Unread(code) => Some((i, code)),
        syntax::Pixels::Plain | syntax::Pixels::Rle | syntax::Pixels::Stream => None,
    }) {
        let number = image.file.saturating_add(1);
        return Err(malformed(FORMAT, format!("file {number}: {}", syntax::unread(code))));
    }
    let per_slice = header.columns.saturating_mul(header.rows);
    let dims = [header.columns, header.rows, layout.depth];
    at_most("voxels", (per_slice as u64).saturating_mul(layout.depth.max(images.len()) as u64), limits.max_voxels)?;
    #[expect(clippy::arithmetic_side_effects, reason = "floating point")]
    let axes = [plane.along_row * plane.spacing[0], plane.along_column * plane.spacing[1], layout.step];
    let lattice = VoxelLattice { origin: layout.origin, axes };
    lattice.check_extent(dims, warnings)?;

    let stored = decode(&images, &layout, per_slice, fetch, warnings)?;
    let Some(stored) = stored else {
        let detail = "two different images lie at one position: the series mixes scans, phases or reconstructions";
        return Err(advised(malformed(FORMAT, detail)));
    };
    let hu = match &layout.uneven {
        None => stored,
        Some(positions) => resample(&stored, per_slice, positions, layout.depth),
    };
    let volume = Volume { dims, origin: lattice.origin, axes: lattice.axes, hu };
    Ok(Assembled { volume, series: stack.series })
}

/// Refuses a series in which some images have a rescale and others have none: they would differ by 1024 HU from slice to slice.
fn check_rescale(images: &[Image]) -> Result<(), ImportError> {
    let missing = images.iter().filter(|i| i.header.encoding.rescale == Rescale::Missing).count();
    if missing == 0 || missing == images.len() {
        return Ok(());
    }
    let detail = format!(
        "{missing} of {} images have no rescale slope or intercept, the others have one; send `rescale_slope` and `rescale_intercept`, \
         or leave those images out",
        images.len()
    );
    Err(malformed(FORMAT, detail))
}

/// Warns of images whose header does not say how to convert them to HU.
fn warn_of_rescale(images: &[Image], warnings: &mut Vec<Warning>) {
    const ACT: &str = "Check the levels of skin and bone, or send `rescale_slope` and `rescale_intercept`.";
    let count = |what| images.iter().filter(|i| i.header.encoding.rescale == what).count();
    let (missing, other) = (count(Rescale::Missing), count(Rescale::Other));
    if missing > 0 {
        let found =
            format!("{missing} images have no rescale slope or intercept: their values are grey values, not HU");
        warnings.push(Warning::check("no-rescale", found).act(ACT));
    }
    if other > 0 {
        let found = format!("the header of {other} images says that their rescaled values are not HU");
        warnings.push(Warning::check("no-rescale", found).act(ACT));
    }
}

fn warn_of_commas(images: &[Image], warnings: &mut Vec<Warning>) {
    let n = images.iter().filter(|i| !i.header.commas.is_empty()).count();
    if n > 0 {
        let mut names: Vec<&str> = images.iter().flat_map(|i| i.header.commas.iter().copied()).collect();
        names.sort_unstable();
        names.dedup();
        let found = format!("{n} images have decimal commas, which were read as points, in {}", names.join(", "));
        warnings.push(Warning::info("decimal-commas", found));
    }
}

/// HU of all slices, in order; `None` when images at the same position differ.
fn decode(
    images: &[Image],
    layout: &StackLayout,
    per_slice: usize,
    fetch: &(dyn Fn(usize) -> Result<Vec<u8>, ImportError> + Sync),
    warnings: &mut Vec<Warning>,
) -> Result<Option<Vec<i16>>, ImportError> {
    // An enhanced image holds all frames in one file, which is fetched once.
    let whole = match images.first() {
        Some(first) if images.len() > 1 && images.iter().all(|i| i.file == first.file) => Some(fetch(first.file)?),
        _ => None,
    };
    let decoded = |at: usize| -> Result<DecodedImage, ImportError> {
        let Some(image) = images.get(at) else { return Err(malformed(FORMAT, "an image is missing")) };
        let bytes = match &whole {
            Some(bytes) => Cow::Borrowed(bytes),
            None => Cow::Owned(fetch(image.file)?),
        };
        let set = DataSet::open(&bytes).map_err(|e| e.in_file(image.file))?;
        let Some(Images { pixels, .. }) = header::read(&set).map_err(|e| e.in_file(image.file))? else {
            return Err(malformed(FORMAT, "an image is missing"));
        };
        pixels::hounsfield(&image.header, &pixels).map_err(|e| e.in_file(image.file))
    };
    let mut hu = vec![AIR; per_slice.saturating_mul(layout.slices.len())];
    let changes: Vec<Changes> = hu
        .par_chunks_mut(per_slice)
        .zip(&layout.slices)
        .map(|(slice, &at)| {
            let found = decoded(at)?;
            slice.copy_from_slice(found.hu.get(..per_slice).unwrap_or_default());
            Ok(Changes { n_padding: found.n_padding, scale: found.scale })
        })
        .collect::<Result<_, ImportError>>()?;
    for duplicate in &layout.duplicates {
        let slice = layout.slices.iter().position(|s| *s == duplicate.slice).unwrap_or(0);
        let start = slice.saturating_mul(per_slice);
        if hu.get(start..start.saturating_add(per_slice)) != Some(&decoded(duplicate.image)?.hu) {
            return Ok(None);
        }
    }
    warn_of_changes(images, &changes, warnings);
    Ok(Some(hu))
}

/// Changes of the values of one slice.
struct Changes {
    n_padding: u64,
    scale: Scale,
}

fn warn_of_changes(images: &[Image], changes: &[Changes], warnings: &mut Vec<Warning>) {
    let n_padding = changes.iter().fold(0u64, |n, slice| n.saturating_add(slice.n_padding));
    if n_padding > 0 {
        let found = format!("{n_padding} pixels outside the scan (padding) were set to {AIR} HU");
        warnings.push(Warning::info("padding-set-to-air", found));
    }
    if images.iter().any(|i| pixels::has_unusable_padding(&i.header.encoding)) {
        let found = "the padding value of some images is also a value of tissue; it was not used";
        warnings.push(Warning::check("padding-in-tissue", found).act("Check the values outside the scanned circle."));
    }
    let lossy = images.iter().filter(|i| i.header.lossy).count();
    if lossy > 0 {
        let found = format!("{lossy} images have lossy compression");
        warnings.push(Warning::check("lossy-compression", found).act("Export the series without lossy compression."));
    }
    let mut sum = Scale::new(1.0, 0.0);
    changes.iter().for_each(|slice| sum.join(&slice.scale));
    sum.report(warnings);
}

/// Interpolates slices at uneven `positions` (in steps) linearly to even ones.
fn resample(stored: &[i16], per_slice: usize, positions: &[f64], depth: usize) -> Vec<i16> {
    let mut hu = vec![AIR; per_slice.saturating_mul(depth)];
    hu.par_chunks_mut(per_slice.max(1)).enumerate().for_each(|(k, out)| {
        let position = k as f64;
        let above = positions.partition_point(|p| *p < position).clamp(1, positions.len().saturating_sub(1).max(1));
        let below = above.saturating_sub(1);
        let (Some(&from), Some(&to)) = (positions.get(below), positions.get(above)) else { return };
        // A slice that is off the lattice only by rounded decimals is copied instead of interpolated.
        let share = ((position - from) / (to - from)).clamp(0.0, 1.0);
        let share = if (share - share.round()).abs() < 1e-2 { share.round() } else { share };
        let slice = |at: usize| stored.iter().skip(at.saturating_mul(per_slice)).take(per_slice);
        for ((value, a), b) in out.iter_mut().zip(slice(below)).zip(slice(above)) {
            *value = (f64::from(*a) * (1.0 - share) + f64::from(*b) * share).round() as i16;
        }
    });
    hu
}
