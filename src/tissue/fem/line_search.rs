//! Line search on the energy that never passes an inverted element.

use super::assembly::Inversion;
use super::dot::dot;
use super::equations::Equations;
use super::tuning::{
    ENERGY_ROUND_OFF, INVERSION_CUT, INVERSION_MARGIN, LEAST_CERTAIN, LONGEST_SHALLOW_STEP, LONGEST_STEP,
    MAX_CONTACT_MOTION_MM, SHALLOW, SHORTEST_STEP, SLOPE_DECREASE, SUFFICIENT_DECREASE,
};
use prosopon_geometry::{Motion, Vector};

/// Reason why no step was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum NoStep {
    /// An element would be inverted by the shortest step.
    Inverted(Inversion),
    /// The energy does not decrease along the direction.
    NoDescent,
    /// The caller cancelled.
    Cancelled,
}

/// Values at the start of the search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Energy, mJ.
    pub(super) energy: f64,
    /// Slope of the energy along the direction, negative.
    pub(super) slope: f64,
    /// Largest penetration, mm.
    pub(super) depth: f64,
    /// Whether the energy is not convex here, so that the model's step may be far too short.
    pub(super) unstable: bool,
}

/// Share of the step `d` to take from `x`.
pub(super) fn search(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    d: &[f64],
    start: &Start,
) -> Result<f64, NoStep> {
    let Start { energy, slope, depth, unstable } = *start;
    let deepest = depth.max(MAX_CONTACT_MOTION_MM);
    let mut step = 1.0;
    let mut inverted = None;
    let glides = !equations.state.springs.is_empty();
    let uncertain = ENERGY_ROUND_OFF * energy.abs() + equations.problem.limits().energy_noise_mj;
    while step >= SHORTEST_STEP {
        equations.state.control.check().map_err(|_| NoStep::Cancelled)?;
        let trial = equations.moved(x, motions, step, d);
        if equations.strays(&trial) {
            step *= 0.5;
            continue;
        }
        match equations.energy(&trial, motions) {
            Ok(found) if found.penetration_mm > deepest => step *= 0.5,
            Ok(found) if found.energy <= energy + SUFFICIENT_DECREASE * step * slope => {
                if step < 1.0 {
                    return Ok(step);
                }
                let most = if unstable {
                    LONGEST_STEP
                } else if glides && slope.abs() > LEAST_CERTAIN * uncertain && is_shallow(found.energy - energy, slope)
                {
                    LONGEST_SHALLOW_STEP
                } else {
                    1.0
                };
                return Ok(extended(equations, (x, d), motions, found.energy, deepest, most));
            }
            // Near the minimum the slope is still accurate where differences of the energy are not.
            Ok(_)
                if (step * slope).abs() <= uncertain
                    && slope_at(equations, &trial, motions, d) <= -SLOPE_DECREASE * slope =>
            {
                return Ok(step);
            }
            Ok(found) => {
                // Minimum of the parabola through the known values, within the usual safeguards.
                let parabola = -0.5 * slope * step * step / (found.energy - energy - slope * step);
                step = if parabola.is_finite() { parabola.clamp(0.1 * step, 0.5 * step) } else { 0.5 * step };
            }
            Err(at) => {
                let direction: Vec<Vector> = trial.iter().zip(x).map(|(a, b)| a - b).collect();
                let first = equations.problem.assembly().first_inversion(x, &direction);
                inverted = first.element.or(Some(at));
                step *= (INVERSION_MARGIN * first.share).min(INVERSION_CUT);
            }
        }
    }
    Err(inverted.map_or(NoStep::NoDescent, NoStep::Inverted))
}

/// Whether the full step, along which the energy changes by `change` from a `slope`, is less than half of that to the minimum of
/// the parabola through these values: the model is then stiffer than the energy.
fn is_shallow(change: f64, slope: f64) -> bool {
    change < SHALLOW * slope
}

/// Doubles the step `d` from `x` while the energy, `energy` at the full step, keeps decreasing, up to `most`.
fn extended(
    equations: &Equations<'_>,
    (x, d): (&[Vector], &[f64]),
    motions: &[Motion],
    mut energy: f64,
    deepest: f64,
    most: f64,
) -> f64 {
    let mut step = 1.0;
    while step < most && !equations.state.control.is_cancelled() {
        let trial = equations.moved(x, motions, 2.0 * step, d);
        if equations.strays(&trial) {
            break;
        }
        match equations.energy(&trial, motions) {
            Ok(found) if found.energy < energy && found.penetration_mm <= deepest => {
                energy = found.energy;
                step *= 2.0;
            }
            Ok(_) | Err(_) => break,
        }
    }
    step
}

/// Absolute slope of the energy along `d`; infinite where an element is inverted.
fn slope_at(equations: &mut Equations<'_>, x: &[Vector], motions: &[Motion], d: &[f64]) -> f64 {
    match equations.balance(x, motions) {
        Ok(_) => dot(equations.work.residual(), d).abs(),
        Err(_) => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::is_shallow;

    /// On `c s² - s` the minimum is at `1 / (2 c)`.
    #[test]
    fn a_step_is_shallow_when_the_minimum_lies_beyond_twice_its_length() {
        let shallow = |c: f64| is_shallow(c - 1.0, -1.0);
        assert!(!shallow(0.5), "the model is exact");
        assert!(!shallow(0.26) && shallow(0.24));
        assert!(shallow(0.0) && shallow(-1.0), "no minimum at all");
    }
}
