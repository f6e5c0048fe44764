//! Whether two skins show one head in one frame.

use rayon::prelude::*;

use super::change::Change;
use super::samples::spread;
use super::tuning::{
    ALIKE_MM, BETTER_SHARE, BEYOND_SYMMETRY_MM, FIT_ITERATIONS, FITTED_SHARE, MIRRORED_SHARE, SAME_HEAD_MM,
    SKIN_SAMPLES,
};
use crate::evaluate::EvaluateError;
use crate::evaluate::distance::Surface;
use prosopon_geometry::{Motion, Point, TriMesh, Vector, Warning};

/// Looks for a mirror image, a turn by 180° or another unit between two skins of one head that need not be registered.
///
/// - `names`: how messages call the two
///
/// Both are brought together rigidly, as given and after each change; a change is reported when it fits far better. Two heads
/// that fit in no way give no finding here: registration and error maps report that.
///
/// # Errors
/// [`EvaluateError::Input`] when the skin is not usable.
pub fn check_two_skins(skin: &TriMesh, other: &TriMesh, names: [&str; 2]) -> Result<Option<Warning>, EvaluateError> {
    let surface = Surface::new(skin)?;
    let points = spread(other, SKIN_SAMPLES);
    if points.is_empty() || median_mm(&surface, &points) <= SAME_HEAD_MM {
        return Ok(None);
    }
    let fitted = |change: &Change| fit_mm(&surface, skin, &change.of(&points));
    let size = other.bounds().diagonal() / skin.bounds().diagonal();
    // A tiny skin lies close to a piece of any other.
    let given = if Change::NONE.is_likely(size) { fitted(&Change::NONE) } else { f64::INFINITY };
    if given <= BEYOND_SYMMETRY_MM {
        return Ok(None);
    }
    let fits: Vec<(Change, f64)> = Change::of_size(size).map(|c| (c, fitted(&c))).collect();
    let best = fits.iter().map(|(_, mm)| *mm).fold(f64::INFINITY, f64::min);
    let limit = if given <= SAME_HEAD_MM { MIRRORED_SHARE } else { BETTER_SHARE };
    let far_better = |mm: f64| mm <= SAME_HEAD_MM && mm <= limit * given;
    // Of changes that fit alike, as mirror images of a symmetric face do, the first is the likeliest.
    let likeliest = fits.into_iter().find(|(_, mm)| far_better(*mm) && *mm <= best + ALIKE_MM);
    Ok(likeliest.map(|(change, mm)| {
        let [skin, other] = names;
        let as_given =
            if given.is_finite() { format!("{given:.1} mm (median)") } else { format!("a factor of {size:.3} in size") };
        let message = format!(
            "{skin} and {other} are not in one frame: laid on each other they differ by {as_given}; with one of the two \
             {change}, by {mm:.1} mm"
        );
        let action = "Find out which of the two files is not in LPS and mm, convert it, and upload it again.";
        Warning::unreliable("surfaces-wrong-frame", message).act(action)
    }))
}

/// Median distance of `points` from the surface, mm; infinite when all closest points lie on its rim.
fn median_mm(surface: &Surface, points: &[Point]) -> f64 {
    let hits: Vec<_> = points.par_iter().map(|p| surface.nearest(p)).collect();
    let mut off: Vec<f64> = hits.iter().filter(|h| !h.on_border).map(|h| h.signed.abs()).collect();
    if off.len() * 10 < points.len() {
        return f64::INFINITY;
    }
    off.sort_by(f64::total_cmp);
    off.get(off.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Median distance after the best rigid motion that is found from two starts: nose on nose, and middle on middle.
fn fit_mm(surface: &Surface, skin: &TriMesh, points: &[Point]) -> f64 {
    let middle = |p: &[Point]| p.iter().map(|p| p.coords).sum::<Vector>() / p.len().max(1) as f64;
    let nose = |p: &[Point]| p.iter().min_by(|a, b| a.y.total_cmp(&b.y)).map_or_else(Vector::zeros, |p| p.coords);
    let on_skin = spread(skin, SKIN_SAMPLES);
    let starts = [middle(&on_skin) - middle(points), nose(skin.positions()) - nose(points)];
    starts.into_iter().map(|by| from_start(surface, points, by)).fold(f64::INFINITY, f64::min)
}

fn from_start(surface: &Surface, points: &[Point], by: Vector) -> f64 {
    let mut now: Vec<Point> = points.iter().map(|p| p + by).collect();
    for _ in 0..FIT_ITERATIONS {
        let hits: Vec<_> = now.par_iter().map(|p| surface.nearest(p)).collect();
        let mut pairs: Vec<(f64, usize)> = hits.iter().enumerate().map(|(i, h)| (h.signed.abs(), i)).collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pairs.truncate((FITTED_SHARE * now.len() as f64) as usize);
        let both: Vec<(Point, Point)> =
            pairs.iter().filter_map(|(_, i)| Some((*now.get(*i)?, hits.get(*i)?.point))).collect();
        let Some(motion) = rigid(&both) else { break };
        now.iter_mut().for_each(|p| *p = motion * *p);
    }
    median_mm(surface, &now)
}

/// The rigid motion that maps the first points onto the second ones (Kabsch 1976).
fn rigid(pairs: &[(Point, Point)]) -> Option<Motion> {
    let n = pairs.len();
    if n < 3 {
        return None;
    }
    let mean = |of: &dyn Fn(&(Point, Point)) -> Vector| pairs.iter().map(of).sum::<Vector>() / n as f64;
    let (from, to) = (mean(&|p| p.0.coords), mean(&|p| p.1.coords));
    let spread: nalgebra::Matrix3<f64> =
        pairs.iter().map(|(a, b)| (b.coords - to) * (a.coords - from).transpose()).sum();
    let turn = nalgebra::UnitQuaternion::from_matrix(&super::pose::nearest_turn(&spread)?);
    let shift = nalgebra::Translation3::from(to - turn * from);
    Some(Motion::from_parts(shift, turn))
}
