//! Orders the slices of a stack and finds the step between them.

use super::FORMAT;
use super::image::{Image, height};
use super::labels::{Attribute, Labels};
use crate::import::ImportError;
use crate::import::error::malformed;
use prosopon_geometry::{Point, Vector, Warning};

/// Slices nearer to each other than this have the same position, mm.
pub(super) const MIN_STEP_MM: f64 = 0.01;
/// Largest deviation of a slice from an evenly spaced stack that counts as even, as a share of the step.
const MAX_UNEVENNESS: f64 = 0.05;
/// Largest distance of a slice from the straight line of the stack, as a share of a pixel.
const MAX_SIDEWAYS: f64 = 0.5;
/// A tilt of the stack above this gives a warning, degrees.
const REPORTED_TILT_DEG: f64 = 0.5;
/// Largest distance of slices as a share of their thickness that counts as without gaps.
const WIDEST_STEP: f64 = 1.4;
/// Most steps that an error lists.
const LISTED: usize = 60;

/// Arrangement of a stack's images in the volume.
#[derive(Debug)]
pub(super) struct StackLayout {
    /// Indices into the images, from the first slice to the last.
    pub(super) slices: Vec<usize>,
    /// Images at the position of a slice.
    pub(super) duplicates: Vec<Duplicate>,
    pub(super) origin: Point,
    /// Step from slice to slice of the volume, LPS mm.
    pub(super) step: Vector,
    /// Position of each slice, in steps from the first; `None` when slices are evenly spaced.
    pub(super) uneven: Option<Vec<f64>>,
    /// Number of slices of the volume.
    pub(super) depth: usize,
}

/// An image at the same position as one that became a slice; both are indices into the images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Duplicate {
    pub(super) image: usize,
    pub(super) slice: usize,
}

/// Orders the images along their normal and finds the step between them.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn layout(
    images: &[Image],
    max_step_mm: f64,
    warnings: &mut Vec<Warning>,
) -> Result<StackLayout, ImportError> {
    let Some(first) = images.first() else { return Err(malformed(FORMAT, "there are no images")) };
    let normal = first.plane.along_row.cross(&first.plane.along_column).normalize();
    let mut order: Vec<(f64, usize)> =
        images.iter().enumerate().map(|(at, image)| (height(images, image), at)).collect();
    // Images at equal heights keep the order of their files.
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));

    let origin_of = |at: usize| images.get(at).map_or_else(Point::origin, |i| i.plane.origin);
    let mut kept: Vec<(f64, usize)> = Vec::new();
    let mut duplicates = Vec::new();
    for (height, at) in order {
        match kept.last() {
            Some(&(below, other)) if height - below < MIN_STEP_MM => {
                if (origin_of(at) - origin_of(other)).norm() > MIN_STEP_MM {
                    return Err(malformed(FORMAT, "two images lie side by side in one plane"));
                }
                duplicates.push(Duplicate { image: at, slice: other });
            }
            _ => kept.push((height, at)),
        }
    }
    if !duplicates.is_empty() {
        let found = format!("{} images are there twice; one of each was used", duplicates.len());
        warnings.push(Warning::info("duplicate-images", found));
    }
    let slices: Vec<usize> = kept.iter().map(|(_, at)| *at).collect();
    let (Some(&(low, bottom)), Some(&(high, top))) = (kept.first(), kept.last()) else {
        return Err(malformed(FORMAT, "there are no images"));
    };
    let origin = origin_of(bottom);
    if kept.len() == 1 {
        warnings.push(
            Warning::check("one-slice", "there is only one slice; a thickness of 1 mm was assumed")
                .act("Send the whole series."),
        );
        return Ok(StackLayout { slices, duplicates, origin, step: normal, uneven: None, depth: 1 });
    }
    // Displacement of the slices' origin for each mm along their normal; longer than 1 when the stack is sheared.
    let slope = (origin_of(top) - origin) / (high - low);
    let sideways =
        kept.iter().map(|(h, at)| (origin_of(*at) - (origin + slope * (h - low))).norm()).fold(0.0, f64::max);
    let pixel = first.plane.spacing[0].min(first.plane.spacing[1]);
    if sideways > MAX_SIDEWAYS * pixel {
        let detail = format!("slices lie up to {sideways:.2} mm off a straight line: they do not form one stack");
        return Err(malformed(FORMAT, detail));
    }
    warn_of_tilt(&slope, warnings);
    let distances: Vec<f64> = kept.iter().map(|(h, _)| (h - low) * slope.norm()).collect();
    let Spacing { step_mm, uneven, depth } = spacing(&distances, max_step_mm, warnings)?;
    Ok(StackLayout { slices, duplicates, origin, step: slope.normalize() * step_mm, uneven, depth })
}

/// A warning where evenly spaced slices leave out a part of the body, as when every second image was lost on the way.
///
/// `alone`: the series has no other stack, with which the numbers of its images could alternate.
#[expect(clippy::arithmetic_side_effects, reason = "floating point, and a remainder by a number that is not zero")]
pub(super) fn gaps(images: &[Image], layout: &StackLayout, alone: bool) -> Option<Warning> {
    let plane = images.first()?.plane;
    let step_mm = layout.step.dot(&plane.along_row.cross(&plane.along_column).normalize()).abs();
    let slices: Vec<&Image> = layout.slices.iter().filter_map(|at| images.get(*at)).collect();
    let labels = || slices.iter().map(|image| &image.header.labels);
    let thickness = |labels: &Labels| labels.get(Attribute::Thickness)?.number;
    let thickest = labels().filter_map(thickness).fold(0.0, f64::max);
    let mut numbers: Vec<i64> = labels().filter_map(|labels| labels.instance).collect();
    numbers.sort_unstable();
    let between = numbers.windows(2).filter_map(|pair| pair.get(1)?.checked_sub(*pair.first()?));
    let divisor = |mut a: i64, mut b: i64| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let stride = if alone && numbers.len() == slices.len() { between.fold(0, divisor) } else { 1 };
    let is_thin = thickest > 0.0 && step_mm > WIDEST_STEP * thickest;
    if !is_thin && (thickest > 0.0 || stride < 2) {
        return None;
    }
    let thin = if is_thin { format!("slices of {thickest:.2} mm lie {step_mm:.2} mm apart") } else { String::new() };
    let strided =
        if stride > 1 { format!("the numbers of the images run in steps of {stride}") } else { String::new() };
    let and = if thin.is_empty() || strided.is_empty() { "" } else { ", and " };
    let found = format!("{thin}{and}{strided}: slices may be missing; what lies between is interpolated linearly");
    Some(
        Warning::check("gaps-between-slices", found)
            .act("Compare the number of images with the scanner's, and send all of them."),
    )
}

fn warn_of_tilt(slope: &Vector, warnings: &mut Vec<Warning>) {
    // The component of `slope` along the normal is 1.
    let tilt = (1.0 / slope.norm()).clamp(-1.0, 1.0).acos().to_degrees();
    if tilt > REPORTED_TILT_DEG {
        let found = format!(
            "the slices are tilted by {tilt:.1}° against the axis of the stack (gantry tilt): the stack is sheared, and is \
             resampled from the true positions of its slices"
        );
        warnings.push(Warning::check("tilted-slices", found).act("Check that the head is not sheared."));
    }
}

/// Spacing of the slices of the volume.
struct Spacing {
    step_mm: f64,
    /// Positions of the images in steps, when they are uneven.
    uneven: Option<Vec<f64>>,
    /// Number of slices of the volume.
    depth: usize,
}

/// The spacing for images at the given `distances` from the first, mm.
fn spacing(distances: &[f64], max_step_mm: f64, warnings: &mut Vec<Warning>) -> Result<Spacing, ImportError> {
    let n = distances.len();
    let range = distances.last().copied().unwrap_or(0.0);
    let even = range / n.saturating_sub(1).max(1) as f64;
    let off = distances.iter().enumerate().map(|(k, h)| (h - even * k as f64).abs()).fold(0.0, f64::max);
    if off <= MAX_UNEVENNESS * even {
        return Ok(Spacing { step_mm: even, uneven: None, depth: n });
    }
    let steps: Vec<f64> = distances.windows(2).filter_map(|w| Some(w.get(1)? - w.first()?)).collect();
    let smallest = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = steps.iter().copied().fold(0.0, f64::max);
    if largest > max_step_mm {
        let listed: Vec<String> = steps.iter().take(LISTED).map(|s| format!("{s:.2}")).collect();
        let detail = format!(
            "the slices are uneven: a step of {largest:.2} mm is above the limit for interpolation of {max_step_mm} mm; \
             slices are missing, or the series mixes several scans. Steps in mm: {}",
            listed.join(", ")
        );
        return Err(malformed(FORMAT, detail));
    }
    let step = smallest.max(0.25);
    let depth = (range / step + 1e-3).floor() as usize;
    let missing = steps
        .iter()
        .map(|s| (s / step).round() as usize)
        .map(|s| s.saturating_sub(1))
        .fold(0usize, usize::saturating_add);
    let whole = steps.iter().all(|s| (s / step - (s / step).round()).abs() < 2.0 * MAX_UNEVENNESS);
    let what = if whole {
        format!("{missing} slices are missing and were interpolated linearly from their neighbours")
    } else {
        format!("the volume was interpolated linearly to steps of {step:.2} mm")
    };
    let found = format!("the slices are uneven, {smallest:.2} to {largest:.2} mm apart: {what}");
    warnings.push(Warning::check("uneven-slices", found).act("Send all slices of the series, not resampled."));
    let uneven = Some(distances.iter().map(|h| h / step).collect());
    Ok(Spacing { step_mm: step, uneven, depth: depth.saturating_add(1) })
}
