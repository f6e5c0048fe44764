//! Orders the slices of a stack and finds the step between them.

use super::FORMAT;
use super::series::Image;
use crate::import::ImportError;
use crate::import::error::malformed;
use prosopon_geometry::{Point, Vector};

/// Slices nearer to each other than this have the same position, mm.
const SAME_PLACE_MM: f64 = 0.01;
/// Largest deviation of a slice from an evenly spaced stack that counts as even, as a share of the step.
const EVEN: f64 = 0.05;
/// Largest distance of a slice from the straight line of the stack, as a share of a pixel.
const ASIDE: f64 = 0.5;
/// A tilt of the stack above this gives a warning, degrees.
const TOLD_TILT_DEG: f64 = 0.5;
/// Most steps that an error lists.
const LISTED: usize = 60;

/// Arrangement of a stack's images in the volume.
#[derive(Debug)]
pub(super) struct Layout {
    /// Indices into the images, from the first slice to the last.
    pub(super) slices: Vec<usize>,
    /// Duplicates: pairs of an image and the slice at the same position.
    pub(super) doubles: Vec<(usize, usize)>,
    pub(super) origin: Point,
    /// Step from slice to slice of the volume, LPS mm.
    pub(super) step: Vector,
    /// Position of each slice, in steps from the first; `None` when slices are evenly spaced.
    pub(super) uneven: Option<Vec<f64>>,
    /// Number of slices of the volume.
    pub(super) depth: usize,
}

/// Orders the images along their normal and finds the step between them.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn layout(images: &[Image], max_step_mm: f64, warnings: &mut Vec<String>) -> Result<Layout, ImportError> {
    let Some(first) = images.first() else { return Err(malformed(FORMAT, "there are no images")) };
    let normal = first.place.along_row.cross(&first.place.along_column).normalize();
    let height = |i: &Image| (i.place.origin - first.place.origin).dot(&normal);
    let mut order: Vec<(f64, usize)> = images.iter().enumerate().map(|(at, image)| (height(image), at)).collect();
    // Images at equal heights keep the order of their files.
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));

    let place = |at: usize| images.get(at).map_or_else(Point::origin, |i| i.place.origin);
    let mut kept: Vec<(f64, usize)> = Vec::new();
    let mut doubles = Vec::new();
    for (height, at) in order {
        match kept.last() {
            Some(&(below, other)) if height - below < SAME_PLACE_MM => {
                if (place(at) - place(other)).norm() > SAME_PLACE_MM {
                    return Err(malformed(FORMAT, "two images lie side by side in one plane"));
                }
                doubles.push((at, other));
            }
            _ => kept.push((height, at)),
        }
    }
    if !doubles.is_empty() {
        warnings.push(format!("{} images are there twice; one of each was used", doubles.len()));
    }
    let slices: Vec<usize> = kept.iter().map(|(_, at)| *at).collect();
    let (Some(&(low, bottom)), Some(&(high, top))) = (kept.first(), kept.last()) else {
        return Err(malformed(FORMAT, "there are no images"));
    };
    let origin = place(bottom);
    if kept.len() == 1 {
        warnings.push("there is only one slice; a thickness of 1 mm was assumed".to_owned());
        return Ok(Layout { slices, doubles, origin, step: normal, uneven: None, depth: 1 });
    }
    // Path per mm of height; it is longer than 1 when the slices are displaced sideways along the stack.
    let way = (place(top) - origin) / (high - low);
    let aside = kept.iter().map(|(h, at)| (place(*at) - (origin + way * (h - low))).norm()).fold(0.0, f64::max);
    let pixel = first.place.spacing[0].min(first.place.spacing[1]);
    if aside > ASIDE * pixel {
        let detail = format!("slices lie up to {aside:.2} mm off a straight line: they do not form one stack");
        return Err(malformed(FORMAT, detail));
    }
    tell_tilt(&way, warnings);
    let places: Vec<f64> = kept.iter().map(|(h, _)| (h - low) * way.norm()).collect();
    let (step, uneven, depth) = spacing(&places, max_step_mm, warnings)?;
    Ok(Layout { slices, doubles, origin, step: way.normalize() * step, uneven, depth })
}

fn tell_tilt(way: &Vector, warnings: &mut Vec<String>) {
    // The component of `way` along the normal is 1.
    let tilt = (1.0 / way.norm()).clamp(-1.0, 1.0).acos().to_degrees();
    if tilt > TOLD_TILT_DEG {
        warnings.push(format!(
            "the slices are tilted by {tilt:.1}° against the axis of the stack (gantry tilt): the stack is sheared, and is \
             resampled from the true positions of its slices"
        ));
    }
}

/// The step (mm), the positions of uneven slices in steps, and the number of evenly spaced slices.
fn spacing(
    places: &[f64],
    max_step_mm: f64,
    warnings: &mut Vec<String>,
) -> Result<(f64, Option<Vec<f64>>, usize), ImportError> {
    let n = places.len();
    let range = places.last().copied().unwrap_or(0.0);
    let even = range / n.saturating_sub(1).max(1) as f64;
    let off = places.iter().enumerate().map(|(k, h)| (h - even * k as f64).abs()).fold(0.0, f64::max);
    if off <= EVEN * even {
        return Ok((even, None, n));
    }
    let steps: Vec<f64> = places.windows(2).filter_map(|w| Some(w.get(1)? - w.first()?)).collect();
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
    let whole = steps.iter().all(|s| (s / step - (s / step).round()).abs() < 2.0 * EVEN);
    let what = if whole {
        format!("{missing} slices are missing and were interpolated linearly from their neighbours")
    } else {
        format!("the volume was interpolated linearly to steps of {step:.2} mm")
    };
    warnings.push(format!("the slices are uneven, {smallest:.2} to {largest:.2} mm apart: {what}"));
    Ok((step, Some(places.iter().map(|h| h / step).collect()), depth.saturating_add(1)))
}
