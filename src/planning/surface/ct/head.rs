use super::components::Components;
use super::distance::{Nearest, to_zero};
use super::tuning::{AIR_REACH_MM, BALL_MM, BUMP_MM, BUMP_TOLERANCE, HU_PER_MM, SHEET_MM};
use prosopon_geometry::ScalarGrid;
use prosopon_geometry::control::{Cancelled, Control};
use rayon::prelude::*;

/// The head without the objects on and around it, with all inner air filled.
pub(super) struct Head {
    /// Negative inside the skin. Values near the skin are in HU, so that the surface has subvoxel accuracy.
    pub(super) skin: ScalarGrid,
    /// Volume removed as sheets, mask and streaks, mm³.
    pub(super) removed_mm3: f64,
}

/// Why a volume shows no head.
#[derive(Debug, Clone, Copy)]
pub(super) enum NoHead {
    /// Nothing denser than the threshold is thick enough.
    NoBody,
    /// No ball of air reaches the volume's border.
    NoAirAround,
    /// The body has no part into which a ball fits.
    OnlyBumps,
}

/// Extracts the head.
pub(super) fn head(
    hu: &ScalarGrid,
    is_open: [[bool; 2]; 3],
    skin_hu: f64,
    control: &Control,
) -> Result<Result<Head, NoHead>, Cancelled> {
    let (dims, h) = (hu.dims, hu.spacing);
    let tissue: Vec<bool> = hu.values.iter().map(|v| *v > skin_hu as f32).collect();
    let Some(solid) = without_sheets(&tissue, dims, SHEET_MM / h) else { return Ok(Err(NoHead::NoBody)) };
    control.check()?;
    control.report(0.3);

    let to_solid = Nearest::of(|at| solid[at].then_some(0.0), dims, cap(BALL_MM / h));
    let ball_fits: Vec<bool> = (0..solid.len()).map(|at| to_solid.is_farther(at, BALL_MM / h)).collect();
    drop(to_solid);
    let components = Components::of(&ball_fits, dims);
    if !components.at_border.iter().any(|b| *b) {
        return Ok(Err(NoHead::NoAirAround));
    }
    // Air that reaches only faces that cut the head is an airway: a thin wall at such a face goes with the sheets.
    let at_open_side = |at: usize| {
        let place = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
        (0..3).any(|a| is_open[a][0] && place[a] == 0 || is_open[a][1] && place[a] + 1 == dims[a])
    };
    let outside = Some(components.any(at_open_side)).filter(|outside| outside.contains(&true));
    let outside = outside.unwrap_or_else(|| components.at_border.clone());
    let ball = components.mask(|c| outside[c]);
    let to_ball = Nearest::of(|at| ball[at].then_some(0.0), dims, cap(AIR_REACH_MM / h));
    drop((ball_fits, ball));
    let mut filled = hu.clone();
    for (at, value) in filled.values.iter_mut().enumerate() {
        let from_tissue = if tissue[at] && !solid[at] { HU_PER_MM * h } else { skin_hu - f64::from(*value) };
        let reached = to_ball.get(at).map_or(f64::MAX, |(d, _)| h * f64::from(d));
        *value = from_tissue.min(HU_PER_MM * (AIR_REACH_MM - reached).max(-AIR_REACH_MM)) as f32;
    }
    drop(to_ball);
    control.check()?;
    control.report(0.6);

    // Protrusions are removed from the filled head because there the wings of the nose are not thin.
    let Some(skin) = without_bumps(filled) else { return Ok(Err(NoHead::OnlyBumps)) };
    let removed = tissue.iter().zip(&skin.values).filter(|(t, v)| **t && **v > 0.0).count();
    Ok(Ok(Head { skin, removed_mm3: removed as f64 * h.powi(3) }))
}

/// Cap of the distance lattice, in whole steps, that covers distances up to `steps`.
fn cap(steps: f64) -> u16 {
    steps.ceil() as u16 + 1
}

/// Largest part of `mask` after everything thinner than `2 steps` is removed, accurate to one step.
fn without_sheets(mask: &[bool], dims: [usize; 3], steps: f64) -> Option<Vec<bool>> {
    let to_empty = Nearest::of(|at| (!mask[at]).then_some(0.0), dims, cap(steps));
    let core: Vec<bool> = (0..mask.len()).map(|at| to_empty.is_farther(at, steps)).collect();
    let components = Components::of(&core, dims);
    let largest = components.largest()?;
    let core = components.mask(|c| c == largest);
    let to_core = Nearest::of(|at| core[at].then_some(0.0), dims, cap(steps + 0.5));
    // Half a step more compensates for the rounding of the lattice.
    Some((0..mask.len()).map(|at| mask[at] && !to_core.is_farther(at, steps + 0.5)).collect())
}

/// Removes everything that a ball of radius [`BUMP_MM`] rolling inside the solid cannot reach.
/// This is the morphological opening of the solid, accurate to a fraction of a step. Keeps only the largest part.
fn without_bumps(mut solid: ScalarGrid) -> Option<ScalarGrid> {
    let (dims, h) = (solid.dims, solid.spacing);
    let radius = (BUMP_MM / h) as f32;
    let values = &solid.values;
    let below = Nearest::of(|at| to_zero(|b| values[b], dims, at), dims, cap(BUMP_MM / h));
    // Negative in the core, the set of positions that the ball's centre can take.
    let mut core: Vec<f32> = (0..values.len())
        .into_par_iter()
        .map(
            |at| if values[at] >= 0.0 { radius } else { below.get(at).map_or(-1.0, |(d, offset)| radius - d - offset) },
        )
        .collect();
    drop(below);
    let components = Components::of(&core.iter().map(|c| *c < 0.0).collect::<Vec<_>>(), dims);
    let largest = components.largest()?;
    let in_largest = components.mask(|c| c == largest);
    core.iter_mut().zip(&in_largest).filter(|(_, l)| !**l).for_each(|(c, _)| *c = c.max(0.0));
    let offset = |at: usize| {
        if core[at] >= 0.0 {
            return None;
        }
        Some(to_zero(|b| core[b], dims, at).unwrap_or(0.0))
    };
    let to_core = Nearest::of(offset, dims, cap(BUMP_MM / h + 1.0));
    let scale = (HU_PER_MM * h) as f32;
    solid.values.par_iter_mut().enumerate().for_each(|(at, value)| {
        let bump = to_core.get(at).map_or(1.0, |(d, offset)| d - offset - radius - BUMP_TOLERANCE);
        *value = value.max(scale * bump);
    });
    Some(solid)
}
