//! Finds the oral slit, along which lips part.
//!
//! [`find`] takes the curve that a client gives, or looks for the crease between the lips in the front of the skin. A slit that
//! is not found for certain is left closed, with a warning.

mod crease;
mod front;
mod place;
#[cfg(test)]
mod tests;
mod tuning;

use crease::{Crease, trace};
use front::Front;
use place::{Place, Source, place};
use prosopon_geometry::{Implicit, Point, TriMesh, Warning};
use prosopon_tissue::mesh::{Slit, SlitKnot};
use tuning::{
    DEFAULT_DEPTH_MM, DEPTH_STEP_MM, KNOT_STEP_MM, LEAST_DEPTH_MM, MAX_CURVE_OFF_MM, MAX_DEPTH_MM, MEDIAN_HALF_MM,
    MIN_HITS, MIN_LIP_MM,
};

/// How the lips are modelled.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Mouth {
    /// The lips are joined.
    #[default]
    Glued,
    /// The lips part along the crease between them.
    Auto,
    /// The lips part along this curve from one commissure to the other, LPS mm; at least three points.
    Curve(Vec<Point>),
}

/// The surfaces in which the slit is looked for.
#[derive(Clone, Copy)]
pub(super) struct Face<'a> {
    pub(super) skin: &'a TriMesh,
    pub(super) skull: &'a TriMesh,
    pub(super) bone: &'a dyn Implicit,
    pub(super) air: Option<&'a dyn Implicit>,
    pub(super) landmarks: &'a [(String, Point)],
}

/// Why no slit was found.
type Reason = String;

/// The slit for `mouth`, with what is to be reported; `None` where the lips stay joined.
pub(super) fn find(face: &Face<'_>, mouth: &Mouth) -> (Option<Slit>, Vec<Warning>) {
    let found = match mouth {
        Mouth::Glued => return (None, Vec::new()),
        Mouth::Auto => by_crease(face),
        Mouth::Curve(points) => by_curve(face, points),
    };
    match found {
        Ok((slit, warnings)) => (Some(slit), warnings),
        Err(reason) => (None, vec![not_parted(&reason)]),
    }
}

/// Warning that the lips stay joined.
pub(super) fn not_parted(reason: &str) -> Warning {
    let warning = Warning::check("mouth-not-parted", format!("the lips are joined in the mesh: {reason}"));
    warning.act("Give the line between the lips, on the skin and in mm, as the curve of `mouth`, or the landmarks of the mouth.")
}

fn by_curve(face: &Face<'_>, points: &[Point]) -> Result<(Slit, Vec<Warning>), Reason> {
    let front = Front::of(face.skin, points, MIN_LIP_MM).ok_or("the curve has no point")?;
    let mut curve = Vec::with_capacity(points.len());
    for (index, p) in points.iter().enumerate() {
        let at = format!("point {index} of the curve, ({:.1}, {:.1}, {:.1}) mm,", p.x, p.y, p.z);
        let y = front.at(p.x, p.z).ok_or_else(|| format!("{at} lies beside the skin"))?;
        if (y - p.y).abs() > MAX_CURVE_OFF_MM {
            return Err(format!("{at} lies {:.1} mm off the skin's front", (y - p.y).abs()));
        }
        curve.push(Point::new(p.x, y, p.z));
    }
    let (slit, mut warnings) = behind(face, &curve)?;
    warnings.insert(0, parted(&slit, "along the curve that was given"));
    // Where no place is known, there is nothing to compare with.
    if let Ok(place) = place(face) {
        warnings.extend(elsewhere(&slit, &place));
    }
    Ok((slit, warnings))
}

/// Warning about a curve that lies where no mouth is.
fn elsewhere(slit: &Slit, place: &Place) -> Option<Warning> {
    let [right, left] = slit.span();
    let by = match place.source {
        Source::Stomion => "the landmark `stomion`",
        Source::Incisors => "the upper incisors",
        Source::Profile => "nose and chin",
    };
    let [low, high] = place.heights;
    let x = place.midline;
    let message = if !(right..left).contains(&x) {
        let (side, mm) = if right > x { ("left", right - x) } else { ("right", x - left) };
        format!("the curve between the lips lies beside the midline: it ends {mm:.0} mm to the {side} of it")
    } else {
        let z = -slit.height(&Point::new(x, slit.front_y(x), 0.0));
        let off = (low - z).max(z - high);
        if off <= MAX_CURVE_OFF_MM {
            return None;
        }
        format!(
            "the curve between the lips lies {off:.0} mm {} where {by} place the mouth",
            if z < low { "below" } else { "above" }
        )
    };
    Some(Warning::check("mouth-elsewhere", message).act("Check the curve that was given as `mouth`."))
}

/// Landmarks on the crease between the lips.
const MOUTH_LANDMARKS: [&str; 3] = ["stomion", "cheilion_right", "cheilion_left"];

fn by_crease(face: &Face<'_>) -> Result<(Slit, Vec<Warning>), Reason> {
    let place = place(face)?;
    let Crease { curve, depth_mm, usual_corner } = trace(face.skin, &place)?;
    for (name, p) in face.landmarks.iter().filter(|(name, _)| MOUTH_LANDMARKS.contains(&name.as_str())) {
        let nearest = curve.iter().map(|q| (q - p).norm()).fold(f64::INFINITY, f64::min);
        if nearest > MAX_CURVE_OFF_MM {
            return Err(format!("the landmark `{name}` lies {nearest:.0} mm off the crease between the lips"));
        }
    }
    let (slit, mut warnings) = behind(face, &curve)?;
    let source = match place.source {
        Source::Stomion => "by the crease of the skin at the landmark `stomion`",
        Source::Incisors => "by the crease of the skin at the height of the upper incisors",
        Source::Profile => "by the crease of the skin between nose and chin",
    };
    warnings.insert(0, parted(&slit, &format!("{source}, which is {depth_mm:.1} mm deep")));
    if usual_corner {
        let message =
            "a corner of the mouth could not be told from folds beside it and was placed at the usual distance";
        let action = "Give the landmarks `cheilion_right` and `cheilion_left`.";
        warnings.push(Warning::check("mouth-corners", message).act(action));
    }
    Ok((slit, warnings))
}

fn parted(slit: &Slit, how: &str) -> Warning {
    let [right, left] = slit.span();
    let message = format!("the lips part over {:.0} mm, {how}", left - right);
    Warning::info("mouth-parted", message)
}

/// The slit from a curve on the skin back to teeth or vestibule.
fn behind(face: &Face<'_>, curve: &[Point]) -> Result<(Slit, Vec<Warning>), Reason> {
    let knots: Vec<SlitKnot> = curve.iter().map(|p| SlitKnot { front: *p, back_y: p.y + DEFAULT_DEPTH_MM }).collect();
    let rough = Slit::new(knots).map_err(|e| e.to_string())?;
    let [right, left] = rough.span();
    let n = ((left - right) / KNOT_STEP_MM).ceil().max(2.0) as usize;
    let along: Vec<Point> = (0..=n)
        .map(|i| {
            let x = right + (left - right) * i as f64 / n as f64;
            let y = rough.front_y(x);
            let z = -rough.height(&Point::new(x, y, 0.0));
            Point::new(x, y, z)
        })
        .collect();
    let depths: Vec<Option<f64>> = along.iter().map(|p| depth(face, p)).collect();
    let hits = depths.iter().flatten().count();
    let mut warnings = Vec::new();
    if (hits as f64) < MIN_HITS * depths.len() as f64 {
        let message = format!(
            "behind {} of {} places between the lips neither teeth nor air were found {LEAST_DEPTH_MM} to {MAX_DEPTH_MM} mm \
             away; the lips are taken to be as thick as beside them, or {DEFAULT_DEPTH_MM} mm",
            depths.len() - hits,
            depths.len()
        );
        warnings.push(Warning::check("mouth-depth", message).act("Check the surfaces of the teeth."));
    }
    let half = (MEDIAN_HALF_MM / KNOT_STEP_MM).ceil() as usize;
    let window = |i: usize| i.saturating_sub(half)..(i + half + 1).min(depths.len());
    let backs: Vec<f64> = along
        .iter()
        .enumerate()
        .map(|(i, p)| p.y + median(&depths[window(i)]).unwrap_or(DEFAULT_DEPTH_MM).max(LEAST_DEPTH_MM))
        .collect();
    // Steps of the median would shear the mesh.
    let knots = along.iter().enumerate().map(|(i, p)| {
        let around = &backs[window(i)];
        let mean = around.iter().sum::<f64>() / around.len() as f64;
        SlitKnot { front: *p, back_y: mean.max(p.y + LEAST_DEPTH_MM) }
    });
    Ok((Slit::new(knots.collect()).map_err(|e| e.to_string())?, warnings))
}

/// Distance straight back from a point between the lips to the first bone or air.
///
/// `None` beyond the greatest depth, and where bone is nearer than the thinnest lips: that is a streak of dental metal.
fn depth(face: &Face<'_>, p: &Point) -> Option<f64> {
    let is_hit = |s: f64| {
        let q = Point::new(p.x, p.y + s, p.z);
        face.bone.value(&q) < 0.0 || face.air.is_some_and(|air| air.value(&q) < 0.0)
    };
    let steps = (MAX_DEPTH_MM / DEPTH_STEP_MM) as u32;
    let first = (LEAST_DEPTH_MM / DEPTH_STEP_MM) as u32;
    let hit = (first..=steps).map(|i| f64::from(i) * DEPTH_STEP_MM).find(|s| is_hit(*s));
    hit.filter(|s| *s > LEAST_DEPTH_MM)
}

fn median(values: &[Option<f64>]) -> Option<f64> {
    let mut known: Vec<f64> = values.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    known.get(known.len() / 2).copied()
}
