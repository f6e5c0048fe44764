//! Chooses the images of an archive that make the volume.

use super::FORMAT;
use super::header::{Header, Place};
use crate::import::error::malformed;
use crate::import::{ImportError, SeriesChoice, VolumeSettings};

/// Directions and spacings that differ by less, through rounded decimals, count as the same.
const SAME: f64 = 1e-3;
/// Largest share of slices that may be left out for their geometry: half of a series does not cover a head.
const MAX_LEFT_OUT: f64 = 0.25;
/// Most geometries (size, spacing, direction) in one series.
const MAX_STACKS: usize = 64;

/// An image with its position, and its file in the archive.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Image {
    /// Index of the file in the archive.
    pub(super) file: usize,
    pub(super) header: Header,
    pub(super) place: Place,
}

/// A series identifier and the images with that identifier.
type Series = (Vec<u8>, Vec<(usize, Header)>);

/// Images of one size and direction.
#[derive(Debug)]
pub(super) struct Stack {
    pub(super) images: Vec<Image>,
    /// Number of the series, from 1, when there are several.
    pub(super) series: Option<usize>,
}

/// Chooses the images of the volume.
///
/// They belong to the requested series, else to the CT series with most slices; within it, they are the largest set of
/// images of one size and direction. Warnings list what was left out. They name series by number, in the order of the
/// identifiers, and never repeat an identifier.
pub(super) fn choose(
    found: Vec<(usize, Header)>,
    settings: &VolumeSettings,
    warnings: &mut Vec<String>,
) -> Result<Stack, ImportError> {
    let mut all: Vec<Series> = Vec::new();
    for (file, header) in found {
        let at = all.binary_search_by(|(uid, _)| uid.cmp(&header.series)).unwrap_or_else(|at| {
            all.insert(at, (header.series.clone(), Vec::new()));
            at
        });
        if let Some((_, images)) = all.get_mut(at) {
            images.push((file, header));
        }
    }
    let summary = |(index, (_, images)): (usize, &Series)| {
        let number = index.saturating_add(1);
        let modality = modality_of(images);
        let size = images.first().map_or((0, 0), |(_, h)| (h.columns, h.rows));
        format!("series {number}: {modality}, {} images of {} x {}", images.len(), size.0, size.1)
    };
    let list = || all.iter().enumerate().map(summary).take(50).collect::<Vec<_>>().join("; ");
    let usable = |images: &[(usize, Header)]| settings.any_modality || modality_of(images) == "CT";
    let chosen = match &settings.series {
        Some(SeriesChoice::Number(n)) => n.checked_sub(1).filter(|n| *n < all.len()),
        Some(SeriesChoice::Uid(uid)) => all.iter().position(|(found, _)| found == uid.as_bytes()),
        // Reversed, so that the first of equally large series is chosen.
        None => (0..all.len())
            .rev()
            .filter(|&s| all.get(s).is_some_and(|(_, i)| usable(i)))
            .max_by_key(|&s| all.get(s).map_or(0, |(_, images)| images.iter().filter(|(_, h)| is_slice(h)).count())),
    };
    let Some(index) = chosen else {
        let detail = match settings.series {
            Some(_) => format!("the requested series was not found; there are {}", list()),
            None => format!("there is no CT series; there are {}", list()),
        };
        return Err(malformed(FORMAT, detail));
    };
    if !all.get(index).is_some_and(|(_, images)| usable(images)) {
        return Err(malformed(FORMAT, format!("the requested series is not a CT; there are {}", list())));
    }
    let series = (all.len() > 1).then(|| index.saturating_add(1));
    if let (Some(number), None) = (series, &settings.series) {
        warnings.push(format!("there are several series; series {number} was taken as the largest CT: {}", list()));
    }
    let images = all.swap_remove(index).1;
    Ok(Stack { images: largest_stack(images, warnings)?, series })
}

/// The series' modality, when all images have the same.
fn modality_of(images: &[(usize, Header)]) -> &str {
    match images {
        [(_, first), rest @ ..] if rest.iter().all(|(_, h)| h.modality == first.modality) => {
            std::str::from_utf8(&first.modality).unwrap_or("??")
        }
        _ => "??",
    }
}

fn is_slice(header: &Header) -> bool {
    !header.localizer && header.frames == 1 && header.samples == 1 && header.place.is_some()
}

fn largest_stack(images: Vec<(usize, Header)>, warnings: &mut Vec<String>) -> Result<Vec<Image>, ImportError> {
    let all = images.len();
    let several = images.iter().filter(|(_, h)| h.frames > 1).count();
    let mut stacks: Vec<Vec<Image>> = Vec::new();
    for (file, header) in images {
        let Some(place) = header.place.filter(|_| is_slice(&header)) else { continue };
        let image = Image { file, header, place };
        let full = stacks.len() == MAX_STACKS;
        match stacks.iter_mut().find(|s| s.first().is_some_and(|other| alike(other, &image))) {
            Some(stack) => stack.push(image),
            None if full => {
                return Err(malformed(
                    FORMAT,
                    format!("the images of the series have more than {MAX_STACKS} sizes and directions"),
                ));
            }
            None => stacks.push(vec![image]),
        }
    }
    let slices: usize = stacks.iter().map(Vec::len).sum();
    let list: Vec<String> = stacks.iter().take(8).map(|s| told(s)).collect();
    // Among equally large stacks the choice does not depend on the order of the files.
    let largest = stacks.into_iter().max_by(|a, b| a.len().cmp(&b.len()).then_with(|| order(b).total_cmp(&order(a))));
    let Some(stack) = largest else {
        let detail = if several > 0 {
            "the images have several frames without positions: export one file per slice"
        } else {
            "no image has a position, orientation and pixel spacing"
        };
        return Err(malformed(FORMAT, detail));
    };
    if slices.saturating_sub(stack.len()) as f64 > MAX_LEFT_OUT * slices as f64 {
        let detail =
            format!("the slices of the series differ in geometry, send only one of these sets: {}", list.join("; "));
        return Err(malformed(FORMAT, detail));
    }
    let left_out = all.saturating_sub(stack.len());
    if left_out > 0 {
        warnings.push(format!(
            "{left_out} images of the series were left out: localizers, or images of another size or direction than most"
        ));
    }
    Ok(stack)
}

/// Describes a stack for messages.
fn told(stack: &[Image]) -> String {
    let Some(first) = stack.first() else { return String::new() };
    let ([x, y], [column, row]) = ([first.header.columns, first.header.rows], first.place.spacing);
    let [a, b] =
        [first.place.along_row, first.place.along_column].map(|d| format!("({:.2}, {:.2}, {:.2})", d.x, d.y, d.z));
    format!("{} of {x} x {y} pixels of {column} x {row} mm along {a} and {b}", stack.len())
}

/// Number that orders stacks by their directions and spacing.
fn order(stack: &[Image]) -> f64 {
    stack.first().map_or(0.0, |i| i.place.along_row.x.mul_add(100.0, i.place.along_column.y) + i.place.spacing[0])
}

/// Whether two images can be slices of one volume.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn alike(a: &Image, b: &Image) -> bool {
    let near = |x: f64, y: f64| (x - y).abs() <= SAME * x.abs();
    (a.header.columns, a.header.rows) == (b.header.columns, b.header.rows)
        && near(a.place.spacing[0], b.place.spacing[0])
        && near(a.place.spacing[1], b.place.spacing[1])
        && (a.place.along_row - b.place.along_row).norm() <= SAME
        && (a.place.along_column - b.place.along_column).norm() <= SAME
}
