//! Whether bone lies within the skin.

use rayon::prelude::*;

use super::change::Change;
use super::samples::spread;
use super::tuning::{
    BONE_SAMPLES, DEEPEST_BONE_MM, DOUBTFUL_OUTSIDE, LEAST_COVERED, LEFT_BY_CAUSE, MOST_INCONSISTENT, OUTSIDE_MM,
    TOO_MUCH_OUTSIDE,
};
use crate::evaluate::EvaluateError;
use crate::evaluate::distance::Surface;
use prosopon_geometry::{Point, TriMesh, Vector, Warning};

/// Checks that `bone` lies within `skin`, and looks for the frame or unit in which it would.
///
/// - `names`: how messages call skin and bone
///
/// Points of bone are measured to the skin; those whose closest point lies on the rim of an open skin are not judged, so that
/// bone may reach beyond a skin that covers the face only. There is no finding for a skin whose triangles face both ways.
///
/// # Errors
/// [`EvaluateError::Input`] when a surface is not usable.
pub fn check_skin_and_bone(skin: &TriMesh, bone: &TriMesh, names: [&str; 2]) -> Result<Option<Warning>, EvaluateError> {
    let surface = Surface::new(skin)?;
    if surface.inconsistent_share() > MOST_INCONSISTENT {
        return Ok(None);
    }
    let Some(outward) = outward(skin) else { return Ok(None) };
    let points = spread(bone, BONE_SAMPLES);
    let given = Nesting::of(&surface, outward, &points);
    if given.is_plausible(DOUBTFUL_OUTSIDE) {
        return Ok(None);
    }
    let size = bone.bounds().diagonal() / skin.bounds().diagonal();
    let fits = |(_, n): &(Change, Nesting)| {
        n.is_plausible(DOUBTFUL_OUTSIDE) && n.outside <= LEFT_BY_CAUSE * given.outside.max(DOUBTFUL_OUTSIDE)
    };
    let changed = |change: Change| (change, Nesting::of(&surface, outward, &change.of(&points)));
    let likely = Change::of_size(size).map(changed).filter(fits);
    // Bone of a wrong size may lie within the skin, but then deeper than that of a face.
    let misfit = |n: &Nesting| n.outside + n.shallow_mm.abs() / DEEPEST_BONE_MM;
    let cause = likely.min_by(|a, b| misfit(&a.1).total_cmp(&misfit(&b.1)));
    let [skin, bone] = names;
    let wrong = given.wrong(names);
    Ok(match cause {
        Some((change, then)) => {
            let message = format!(
                "{skin} and {bone} are not in one frame: {wrong}; with one of the two {change}, {:.0} % would lie outside",
                100.0 * then.outside
            );
            let action = "Find out which of the two files is not in LPS and mm, convert it, and upload it again.";
            Some(Warning::unreliable("surfaces-wrong-frame", message).act(action))
        }
        None if given.is_plausible(TOO_MUCH_OUTSIDE) => None,
        None => {
            let message =
                format!("{skin} and {bone} do not belong together: {wrong}, and no likely frame or unit fits");
            Some(
                Warning::unreliable("surfaces-cross", message).act("Check that both files show one head in one frame."),
            )
        }
    })
}

/// 1 for a skin whose normals point out of the head, -1 for one inside out; `None` when it encloses nothing.
fn outward(skin: &TriMesh) -> Option<f64> {
    let middle = skin.bounds().center();
    let through = |t: usize| {
        let [a, b, c] = skin.corners(t);
        let center = Point::from((a.coords + b.coords + c.coords) / 3.0);
        skin.scaled_normal(t).dot(&(center - middle))
    };
    let flux: f64 = (0..skin.triangles().len()).map(through).sum();
    let area: f64 = (0..skin.triangles().len()).map(|t| Vector::norm(&skin.scaled_normal(t))).sum();
    (flux.abs() > 0.01 * area * skin.bounds().diagonal()).then(|| flux.signum())
}

/// How bone lies in the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nesting {
    /// Share of all points whose closest point of the skin is not on its rim.
    pub(super) covered: f64,
    /// Share of these points that lie outside.
    pub(super) outside: f64,
    /// Largest distance of one of them outside, mm.
    pub(super) farthest_mm: f64,
    /// Depth of the shallowest tenth, mm.
    pub(super) shallow_mm: f64,
}

impl Nesting {
    pub(super) fn of(skin: &Surface, outward: f64, points: &[Point]) -> Self {
        let hits: Vec<_> = points.par_iter().map(|p| skin.nearest(p)).collect();
        let mut height: Vec<f64> = hits.iter().filter(|h| !h.on_border).map(|h| outward * h.signed).collect();
        height.sort_by(f64::total_cmp);
        let n = height.len();
        let out = height.iter().filter(|h| **h > OUTSIDE_MM).count();
        Self {
            covered: n as f64 / points.len().max(1) as f64,
            outside: out as f64 / n.max(1) as f64,
            farthest_mm: height.last().copied().unwrap_or(0.0).max(0.0),
            shallow_mm: -height.get(n.saturating_sub(1 + n / 10)).copied().unwrap_or(0.0),
        }
    }

    fn is_plausible(&self, most_outside: f64) -> bool {
        // Bone beyond an open skin, none of which can be judged, is neither in nor out.
        self.covered < LEAST_COVERED || (self.outside <= most_outside && self.shallow_mm <= DEEPEST_BONE_MM)
    }

    fn wrong(&self, [skin, bone]: [&str; 2]) -> String {
        if self.shallow_mm > DEEPEST_BONE_MM {
            return format!("nine tenths of the {bone} lie more than {:.0} mm below the {skin}", self.shallow_mm);
        }
        format!(
            "{:.0} % of the {bone} lie more than {OUTSIDE_MM} mm outside the {skin}, up to {:.0} mm",
            100.0 * self.outside,
            self.farthest_mm
        )
    }
}
