//! Chooses the images of an archive that make the volume.

use std::cmp::Ordering;

use super::FORMAT;
use super::header::{Header, ImagePlane};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::volume_settings::{SeriesChoice, VolumeSettings};
use prosopon_geometry::Warning;

/// Directions and spacings that differ by less, through rounded decimals, count as the same.
const MAX_DIFFERENCE: f64 = 1e-3;
/// Largest share of slices that may be left out for their geometry: half of a series does not cover a head.
const MAX_LEFT_OUT_SHARE: f64 = 0.25;
/// Most geometries (size, spacing, direction) in one series.
const MAX_STACKS: usize = 64;

/// An image with its position, and its file in the archive.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Image {
    /// Index of the file in the archive.
    pub(super) file: usize,
    pub(super) header: Header,
    pub(super) plane: ImagePlane,
}

/// The images with one series identifier.
struct Series {
    uid: Vec<u8>,
    /// Index of the file in the archive, and header.
    images: Vec<(usize, Header)>,
}

impl Series {
    /// The modality, when all images have the same.
    fn modality(&self) -> &str {
        match self.images.as_slice() {
            [(_, first), rest @ ..] if rest.iter().all(|(_, h)| h.modality == first.modality) => {
                std::str::from_utf8(&first.modality).unwrap_or("??")
            }
            _ => "??",
        }
    }

    fn n_slices(&self) -> usize {
        self.images.iter().filter(|(_, h)| is_slice(h)).count()
    }
}

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
    warnings: &mut Vec<Warning>,
) -> Result<Stack, ImportError> {
    let mut all = by_series(found);
    let list = list(&all);
    let usable = |series: &Series| settings.any_modality || series.modality() == "CT";
    let chosen = match &settings.series {
        Some(SeriesChoice::Number(n)) => n.checked_sub(1).filter(|n| *n < all.len()),
        Some(SeriesChoice::Uid(uid)) => all.iter().position(|series| series.uid == uid.as_bytes()),
        // Reversed, so that the first of equally large series is chosen.
        None => (0..all.len())
            .rev()
            .filter(|&s| all.get(s).is_some_and(usable))
            .max_by_key(|&s| all.get(s).map_or(0, Series::n_slices)),
    };
    let Some(index) = chosen else {
        let detail = match settings.series {
            Some(_) => format!("the requested series was not found; there are {list}"),
            None => format!("there is no CT series; there are {list}"),
        };
        return Err(malformed(FORMAT, detail));
    };
    if !all.get(index).is_some_and(usable) {
        return Err(malformed(FORMAT, format!("the requested series is not a CT; there are {list}")));
    }
    let series = (all.len() > 1).then(|| index.saturating_add(1));
    if let (Some(number), None) = (series, &settings.series) {
        let found = format!("there are several series; series {number} was taken as the largest CT: {list}");
        warnings
            .push(Warning::check("several-series", found).act("Request another series if this is not the right one."));
    }
    Ok(Stack { images: largest_stack(all.swap_remove(index).images, warnings)?, series })
}

/// The images by series, in the order of the identifiers.
fn by_series(found: Vec<(usize, Header)>) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for (file, header) in found {
        let at = all.binary_search_by(|series| series.uid.cmp(&header.series)).unwrap_or_else(|at| {
            all.insert(at, Series { uid: header.series.clone(), images: Vec::new() });
            at
        });
        if let Some(series) = all.get_mut(at) {
            series.images.push((file, header));
        }
    }
    all
}

/// Describes up to 50 series by number, modality and size, without their identifiers.
fn list(all: &[Series]) -> String {
    let summary = |(index, series): (usize, &Series)| {
        let number = index.saturating_add(1);
        let size = series.images.first().map_or((0, 0), |(_, h)| (h.columns, h.rows));
        let n = series.images.len();
        format!("series {number}: {}, {n} images of {} x {}", series.modality(), size.0, size.1)
    };
    all.iter().enumerate().map(summary).take(50).collect::<Vec<_>>().join("; ")
}

fn is_slice(header: &Header) -> bool {
    !header.localizer && header.frames == 1 && header.samples == 1 && header.plane.is_some()
}

fn largest_stack(images: Vec<(usize, Header)>, warnings: &mut Vec<Warning>) -> Result<Vec<Image>, ImportError> {
    let all = images.len();
    let several = images.iter().filter(|(_, h)| h.frames > 1).count();
    let mut stacks: Vec<Vec<Image>> = Vec::new();
    for (file, header) in images {
        let Some(plane) = header.plane.filter(|_| is_slice(&header)) else { continue };
        let image = Image { file, header, plane };
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
    let list: Vec<String> = stacks.iter().take(8).map(|s| description(s)).collect();
    // Among equally large stacks the choice does not depend on the order of the files.
    let largest = stacks.into_iter().max_by(|a, b| a.len().cmp(&b.len()).then_with(|| order(b, a)));
    let Some(stack) = largest else {
        let detail = if several > 0 {
            "the images have several frames without positions: export one file per slice"
        } else {
            "no image has a position, orientation and pixel spacing"
        };
        return Err(malformed(FORMAT, detail));
    };
    if slices.saturating_sub(stack.len()) as f64 > MAX_LEFT_OUT_SHARE * slices as f64 {
        let detail =
            format!("the slices of the series differ in geometry, send only one of these sets: {}", list.join("; "));
        return Err(malformed(FORMAT, detail));
    }
    let not_slices = all.saturating_sub(slices);
    if not_slices > 0 {
        let found =
            format!("{not_slices} images of the series were left out: localizers, or images without a position");
        warnings.push(Warning::info("localizers-left-out", found));
    }
    let others = slices.saturating_sub(stack.len());
    if others > 0 {
        let found = format!("{others} images of another size or direction than most of the series were left out");
        warnings.push(Warning::check("slices-left-out", found).act("Check that the volume covers the head."));
    }
    Ok(stack)
}

/// Describes a stack for messages.
fn description(stack: &[Image]) -> String {
    let Some(first) = stack.first() else { return String::new() };
    let ([x, y], [column, row]) = ([first.header.columns, first.header.rows], first.plane.spacing);
    let [a, b] =
        [first.plane.along_row, first.plane.along_column].map(|d| format!("({:.2}, {:.2}, {:.2})", d.x, d.y, d.z));
    format!("{} of {x} x {y} pixels of {column} x {row} mm along {a} and {b}", stack.len())
}

/// Orders stacks by the directions of their images, then by spacing and size.
fn order(a: &[Image], b: &[Image]) -> Ordering {
    let (Some(a), Some(b)) = (a.first(), b.first()) else { return a.len().cmp(&b.len()) };
    let size = |image: &Image| (image.header.columns, image.header.rows);
    plane_order(&a.plane, &b.plane).then(size(a).cmp(&size(b)))
}

/// Orders planes by their directions, then by spacing, one component after another.
fn plane_order(a: &ImagePlane, b: &ImagePlane) -> Ordering {
    let key = |plane: &ImagePlane| {
        let ImagePlane { along_row: r, along_column: c, spacing: [columns, rows], .. } = *plane;
        [r.x, r.y, r.z, c.x, c.y, c.z, columns, rows]
    };
    key(a).into_iter().zip(key(b)).fold(Ordering::Equal, |order, (a, b)| order.then(a.total_cmp(&b)))
}

/// Whether two images can be slices of one volume.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
fn alike(a: &Image, b: &Image) -> bool {
    let near = |x: f64, y: f64| (x - y).abs() <= MAX_DIFFERENCE * x.abs();
    (a.header.columns, a.header.rows) == (b.header.columns, b.header.rows)
        && near(a.plane.spacing[0], b.plane.spacing[0])
        && near(a.plane.spacing[1], b.plane.spacing[1])
        && (a.plane.along_row - b.plane.along_row).norm() <= MAX_DIFFERENCE
        && (a.plane.along_column - b.plane.along_column).norm() <= MAX_DIFFERENCE
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::{Point, Vector};

    #[test]
    fn planes_that_differ_are_never_equal_in_order() {
        // A difference in direction that one in spacing would cancel in a sum.
        let (sin, cos) = (0.25f64, (1.0 - 0.25f64 * 0.25).sqrt());
        let plane = |along_column: Vector, spacing: f64| ImagePlane {
            origin: Point::origin(),
            along_row: Vector::z(),
            along_column,
            spacing: [spacing, 1.0],
        };
        let (a, b) = (plane(Vector::new(cos, 0.0, sin), 0.75), plane(Vector::new(cos, sin, 0.0), 0.5));
        assert_eq!(plane_order(&a, &b), Ordering::Less);
        assert_eq!(plane_order(&b, &a), Ordering::Greater);
        assert_eq!(plane_order(&a, &a), Ordering::Equal);
    }
}
