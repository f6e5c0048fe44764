//! Line search on the energy that never steps over an inverted element.

use super::assembly::Inversion;
use super::equations::Equations;
use super::linear_solve::dot;
use super::newton::MAX_CONTACT_MOTION_MM;
use prosopon_geometry::{Motion, Vector};

/// Share of the way to the first inversion that is taken at most.
const INVERSION_MARGIN: f64 = 0.9;
/// Armijo's constant.
const SUFFICIENT: f64 = 1e-4;
/// Below this change, relative to the energy, energies cannot be told apart safely.
const ROUND_OFF: f64 = 1e-9;
/// Longest multiple of a Newton step: at a saddle of the energy, where a point is to leave a rim of the bone, the model says little of how far.
const LONGEST: f64 = 1024.0;
/// Shortest share of a Newton step.
const SHORTEST: f64 = 1e-5;

/// Why no step was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cut {
    /// An element would be inverted by the shortest step.
    Inverted(Inversion),
    /// The energy does not fall.
    NoDescent,
}

/// What is known where the search starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Energy, mJ.
    pub(super) energy: f64,
    /// Its slope along the direction, negative.
    pub(super) slope: f64,
    /// Largest penetration, mm.
    pub(super) depth: f64,
    /// The energy is not convex here, so that the model's step may be far too short.
    pub(super) unstable: bool,
}

/// Share of `d` to take from `x`.
pub(super) fn along(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    d: &[f64],
    start: &Start,
) -> Result<f64, Cut> {
    let Start { energy, slope, depth, unstable } = *start;
    let deepest = depth.max(MAX_CONTACT_MOTION_MM);
    let mut step = 1.0;
    let mut inverted = None;
    let uncertain = ROUND_OFF * energy.abs() + equations.limits.energy_noise_mj;
    while step >= SHORTEST {
        let mut trial = x.to_vec();
        equations.dofs.add(step, d, &mut trial);
        match equations.energy(&trial, motions) {
            Ok((_, depth)) if depth > deepest => step *= 0.5,
            Ok((found, _)) if found <= energy + SUFFICIENT * step * slope => {
                let longer = unstable && step == 1.0;
                return Ok(if longer { extended(equations, x, motions, d, found, deepest) } else { step });
            }
            // Near the minimum the slope still tells what the energy cannot.
            Ok(_) if (step * slope).abs() <= uncertain && slope_at(equations, &trial, motions, d) <= -0.9 * slope => {
                return Ok(step);
            }
            Ok((found, _)) => {
                // Minimum of the parabola through what is known, kept within the usual safeguards.
                let parabola = -0.5 * slope * step * step / (found - energy - slope * step);
                step = if parabola.is_finite() { parabola.clamp(0.1 * step, 0.5 * step) } else { 0.5 * step };
            }
            Err(at) => {
                let direction: Vec<Vector> = trial.iter().zip(x).map(|(a, b)| a - b).collect();
                let (share, first) = equations.assembly.first_inversion(x, &direction);
                inverted = first.or(Some(at));
                step *= (INVERSION_MARGIN * share).min(0.95);
            }
        }
    }
    Err(inverted.map_or(Cut::NoDescent, Cut::Inverted))
}

/// Doubles the step while the energy, `energy` at the whole step, goes on falling.
fn extended(
    equations: &Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    d: &[f64],
    mut energy: f64,
    deepest: f64,
) -> f64 {
    let mut step = 1.0;
    while step < LONGEST {
        let mut trial = x.to_vec();
        equations.dofs.add(2.0 * step, d, &mut trial);
        match equations.energy(&trial, motions) {
            Ok((found, depth)) if found < energy && depth <= deepest => {
                energy = found;
                step *= 2.0;
            }
            _ => break,
        }
    }
    step
}

/// Magnitude of the energy's slope along `d`; infinite where an element is inverted.
fn slope_at(equations: &mut Equations<'_>, x: &[Vector], motions: &[Motion], d: &[f64]) -> f64 {
    match equations.balance(x, motions) {
        Ok(_) => dot(&equations.residual, d).abs(),
        Err(_) => f64::INFINITY,
    }
}
