//! Chooses the images of an archive that make the volume.

use std::cmp::Ordering;

use super::FORMAT;
use super::header::{Header, ImagePlane};
use super::image::{Image, alike, height};
use super::phases::{Split, split};
use crate::import::ImportError;
use crate::import::error::malformed;
use crate::import::volume_settings::{SeriesChoice, VolumeSettings};
use prosopon_geometry::Warning;

/// Largest share of slices that may be left out for their geometry: half of a series does not cover a head.
const MAX_LEFT_OUT_SHARE: f64 = 0.25;
/// Most geometries (size, spacing, direction) in one series.
const MAX_STACKS: usize = 64;
/// Most series or stacks that a message lists.
const LISTED: usize = 50;

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
    /// The numbered stacks of the series, when there are several and the request chose none.
    pub(super) several: Option<String>,
}

/// Chooses the images of the volume.
///
/// They belong to the requested series, else to the CT series with most slices; within it, they are the requested stack, else
/// the largest set of images of one size and direction. Warnings list what was left out. They name series by number, in the
/// order of the identifiers, and never repeat an identifier.
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
    let (images, several) = stack_of(all.swap_remove(index).images, settings.stack, warnings)?;
    Ok(Stack { images, series, several })
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
    all.iter().enumerate().map(summary).take(LISTED).collect::<Vec<_>>().join("; ")
}

fn is_slice(header: &Header) -> bool {
    !header.localizer && header.frames == 1 && header.samples == 1 && header.plane.is_some()
}

/// The images by size, spacing and direction: the largest set first, and without the images that are no slices.
fn by_geometry(images: Vec<(usize, Header)>) -> Result<Vec<Vec<Image>>, ImportError> {
    let mut sets: Vec<Vec<Image>> = Vec::new();
    for (file, header) in images {
        let Some(plane) = header.plane.filter(|_| is_slice(&header)) else { continue };
        let image = Image { file, header, plane };
        let full = sets.len() == MAX_STACKS;
        match sets.iter_mut().find(|s| s.first().is_some_and(|other| alike(other, &image))) {
            Some(set) => set.push(image),
            None if full => {
                return Err(malformed(
                    FORMAT,
                    format!("the images of the series have more than {MAX_STACKS} sizes and directions"),
                ));
            }
            None => sets.push(vec![image]),
        }
    }
    // Among equally large sets the order does not depend on that of the files.
    sets.sort_by(|a, b| b.len().cmp(&a.len()).then_with(|| order(a, b)));
    Ok(sets)
}

/// The images of the requested stack, else of the largest geometry; with the numbered stacks when there are several.
fn stack_of(
    images: Vec<(usize, Header)>,
    requested: Option<usize>,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<Image>, Option<String>), ImportError> {
    let all = images.len();
    let several_frames = images.iter().any(|(_, h)| h.frames > 1);
    let mut sets = by_geometry(images)?;
    let slices: usize = sets.iter().map(Vec::len).sum();
    let Some(largest) = sets.first() else {
        let detail = if several_frames {
            "the images have several frames without positions: export one file per slice"
        } else {
            "no image has a position, orientation and pixel spacing"
        };
        return Err(malformed(FORMAT, detail));
    };
    let splits: Vec<Option<Split>> = sets.iter().map(|set| split(set)).collect();
    let parts = parts(&sets, &splits);
    let list: Vec<String> = parts.iter().take(LISTED).map(|part| part.text.clone()).collect();
    let list = list.join("; ");
    let left_out_slices = all.saturating_sub(slices);
    if left_out_slices > 0 {
        let found =
            format!("{left_out_slices} images of the series were left out: localizers, or images without a position");
        warnings.push(Warning::info("localizers-left-out", found));
    }
    if let Some(number) = requested {
        let part = number.checked_sub(1).and_then(|at| parts.get(at)).ok_or_else(|| {
            malformed(FORMAT, format!("stack {number} was requested, but the series has {}: {list}", parts.len()))
        })?;
        let set = sets.get(part.set).map(Vec::as_slice).unwrap_or_default();
        return Ok((part.images.iter().filter_map(|at| set.get(*at).cloned()).collect(), None));
    }
    let others = slices.saturating_sub(largest.len());
    if others as f64 > MAX_LEFT_OUT_SHARE * slices as f64 {
        let detail = format!("the slices of the series differ in geometry; choose one stack with `stack`: {list}");
        return Err(malformed(FORMAT, detail));
    }
    if others > 0 {
        let found = format!("{others} images of another size or direction than most of the series were left out");
        warnings.push(Warning::check("slices-left-out", found).act("Check that the volume covers the head."));
    }
    if let Some(Some(Split { overlaps: false, .. })) = splits.first() {
        let found = format!("slices of several scans lie between each other and were read as one volume: {list}");
        warnings.push(Warning::check("interleaved-stacks", found).act("Send `stack` with the number of one of them."));
    }
    let several = (parts.len() > 1).then_some(list);
    Ok((sets.swap_remove(0), several))
}

/// Images that make one volume.
struct Part {
    /// Index of their geometry.
    set: usize,
    /// Their indices in it.
    images: Vec<usize>,
    /// Number and description.
    text: String,
}

/// All stacks, numbered from 1: those of the largest geometry first.
fn parts(sets: &[Vec<Image>], splits: &[Option<Split>]) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    for (index, (set, split)) in sets.iter().zip(splits).enumerate() {
        let groups = match split {
            Some(split) => split.groups.clone(),
            None => vec![((0..set.len()).collect(), String::new())],
        };
        for (images, what) in groups {
            let of: Vec<&Image> = images.iter().filter_map(|at| set.get(*at)).collect();
            let comma = if what.is_empty() { "" } else { ", " };
            let text = format!("stack {}: {}{comma}{what}", parts.len().saturating_add(1), description(&of));
            parts.push(Part { set: index, images, text });
        }
    }
    parts
}

/// Describes a stack for messages: size, direction, and the range along its normal.
fn description(stack: &[&Image]) -> String {
    let Some(first) = stack.first() else { return String::new() };
    let ([x, y], [column, row]) = ([first.header.columns, first.header.rows], first.plane.spacing);
    let [a, b] =
        [first.plane.along_row, first.plane.along_column].map(|d| format!("({:.2}, {:.2}, {:.2})", d.x, d.y, d.z));
    let along = |image: &&&Image| height(std::slice::from_ref(*first), image);
    let end = |order: fn(&f64, &f64) -> Ordering| {
        let far = stack.iter().max_by(|p, q| order(&along(p), &along(q)));
        far.map_or_else(String::new, |i| {
            let [x, y, z] = [i.plane.origin.x, i.plane.origin.y, i.plane.origin.z];
            format!("({x:.1}, {y:.1}, {z:.1})")
        })
    };
    let (from, to) = (end(|p, q| q.total_cmp(p)), end(f64::total_cmp));
    format!("{} of {x} x {y} pixels of {column} x {row} mm along {a} and {b}, from {from} to {to} mm", stack.len())
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
