//! Newton's method on the total potential energy at fixed positions of the bones.

use super::contact::{ContactPair, penetration, tested_penetration};
use super::dot::dot;
use super::equations::{Balance, Equations};
use super::failure::Failure;
use super::line_search::{self, NoStep, Start};
use super::problem::Limits;
use super::quadratic_model::{CurvatureTerms, Goal, minimise_model};
use super::report::IterationRecord;
use super::springs::TangentKind;
use super::state::Purpose;
use super::tuning::{
    COARSE_DISPLACEMENT, COARSE_RESIDUAL, CONDENSED_ITERATIONS, CONDENSED_MAX_RATIO, DISPLACEMENT_TOLERANCE,
    DISPLAY_STEP_MM, FORCING, FORCING_AT_END, FORCING_RANGE, ITERATIONS_WITHOUT_CURVATURE, MAX_MULTIPLIER_UPDATES,
    MAX_PULL_OFFS, PART_CURVATURE_BELOW_MM, PART_CURVATURE_SHARE, POOR_STEP, SHORT_STEP, SLOW_PENETRATION, STIFFER,
    WHOLE_CURVATURE_BELOW_MM,
};
use prosopon_geometry::{Motion, Vector};

/// An equilibrium that was reached.
#[derive(Debug, Clone)]
pub(super) struct Equilibrium {
    pub(super) iterations: usize,
    /// Residual relative to the reaction force, or to the force floor when the reaction is smaller.
    pub(super) relative_residual: f64,
    /// Largest remaining displacement, estimated with the current factor, mm.
    pub(super) remaining_mm: f64,
    /// Active contacts.
    pub(super) contacts: Vec<ContactPair>,
}

/// Motions of the bodies at path parameter `t`, at which equilibrium is sought.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target<'a> {
    pub(super) t: f64,
    pub(super) motions: &'a [Motion],
}

/// Residual force and its tolerance, N.
#[derive(Debug, Clone, Copy)]
struct ResidualTest {
    residual_n: f64,
    tolerance_n: f64,
}

/// What the next quadratic model includes, as the last iterations suggest.
#[derive(Debug, Clone, Copy)]
struct ModelChoice {
    kind: TangentKind,
    terms: CurvatureTerms,
    /// Iterations left without the curvature of contact.
    wait: usize,
    /// Largest displacement of a node in the last iteration, mm.
    moved_mm: f64,
}

/// A descent direction, and the balance at its start.
struct Direction {
    d: Vec<f64>,
    balance: Balance,
}

/// Iterates `x` to equilibrium. Its held nodes must be in place, and no element may be inverted.
pub(super) fn equilibrate(
    equations: &mut Equations<'_>,
    x: &mut [Vector],
    target: Target<'_>,
) -> Result<Equilibrium, Failure> {
    equations.state.begin_attempt();
    let result = augmented(equations, x, target);
    if result.is_err() {
        equations.state.set_failed(x);
    }
    result
}

/// Outer iteration of the augmented Lagrangian around Newton's method.
fn augmented(equations: &mut Equations<'_>, x: &mut [Vector], target: Target<'_>) -> Result<Equilibrium, Failure> {
    let limits = *equations.problem.limits();
    let mut iterations = 0;
    let (mut last_penetration, mut last_gap) = (f64::INFINITY, f64::INFINITY);
    let mut pull_offs = 0;
    let full = match equations.state.purpose {
        Purpose::Measurement => limits.relative_residual,
        Purpose::Display => limits.relative_residual.max(COARSE_RESIDUAL),
    };
    // Multipliers converge to the contact pressure without an exact equilibrium.
    let glides = !equations.state.springs.is_empty();
    let mut aim = if equations.state.contact.is_empty() && !glides { full } else { full.max(COARSE_RESIDUAL) };
    for _ in 0..=MAX_MULTIPLIER_UPDATES + MAX_PULL_OFFS {
        let found = newton(equations, x, target, aim)?;
        iterations += found.iterations;
        let depth = tested_penetration(&found.contacts);
        let gap = equations.state.springs.largest_gap_mm(x, target.motions);
        if depth.max(gap) > limits.penetration_tolerance_mm {
            let is_slow =
                |found: f64, last: f64| found > limits.penetration_tolerance_mm && found > SLOW_PENETRATION * last;
            if depth > limits.penetration_tolerance_mm {
                equations.state.contact.augment(&found.contacts);
            }
            if gap > limits.penetration_tolerance_mm {
                equations.state.springs.augment(x, target.motions);
            }
            if is_slow(depth, last_penetration) {
                equations.state.contact.stiffen(STIFFER);
            }
            if is_slow(gap, last_gap) {
                equations.state.springs.stiffen(STIFFER);
                equations.work.solver_mut().refresh();
            }
            (last_penetration, last_gap) = (depth, gap);
        } else if pull_offs < MAX_PULL_OFFS && equations.pull_off(x, target.motions) > 0 {
            pull_offs += 1;
        } else if aim > full {
            aim = full;
        } else {
            return Ok(Equilibrium { iterations, ..found });
        }
    }
    Err(Failure::Penetration { found_mm: last_penetration.max(last_gap) })
}

/// Iterates until the residual is below `aim` relative to the reactions.
fn newton(
    equations: &mut Equations<'_>,
    x: &mut [Vector],
    target: Target<'_>,
    aim: f64,
) -> Result<Equilibrium, Failure> {
    let limits = *equations.problem.limits();
    let has_springs = !equations.state.springs.is_empty();
    let share = if aim > limits.relative_residual { COARSE_DISPLACEMENT } else { DISPLACEMENT_TOLERANCE };
    let enough_mm = share * limits.element_size_mm;
    let mut choice = ModelChoice::first();
    let mut last = ResidualTest { residual_n: f64::INFINITY, tolerance_n: 0.0 };
    for iteration in 0..=limits.max_iterations {
        equations.state.control.check()?;
        equations.state.uses_condensed &= iteration < CONDENSED_ITERATIONS;
        let balance = equations.balance(x, target.motions)?;
        last = ResidualTest::of(&balance, aim, &limits);
        let remaining_mm =
            if last.is_met() { equations.work.remaining_change(&equations.problem) } else { f64::INFINITY };
        if remaining_mm <= enough_mm {
            let relative_residual = aim * last.residual_n / last.tolerance_n;
            let contacts = balance.contacts;
            return Ok(Equilibrium { iterations: iteration, remaining_mm, relative_residual, contacts });
        }
        if iteration == limits.max_iterations {
            break;
        }
        let forcing = forcing(&balance, last, &limits);
        let mut record = record_of(target.t, &balance);
        let Direction { d, balance } =
            direction(equations, x, target.motions, balance, &mut choice, forcing, &mut record)?;
        // Where a point of contact passes from one triangle to the next, steps may become ever shorter.
        let step_mm = equations.problem.dofs().max_position_change(&d);
        if choice.moved_mm < SHORT_STEP * enough_mm && last.is_met() && step_mm <= enough_mm {
            let relative_residual = aim * last.residual_n / last.tolerance_n;
            let contacts = balance.contacts;
            return Ok(Equilibrium { iterations: iteration + 1, remaining_mm: step_mm, relative_residual, contacts });
        }
        match step_along(equations, x, target.motions, &d, &balance, &record) {
            Ok(step) => {
                take_step(equations, x, target.motions, &d, step, &mut record, &mut choice);
                if let Some(shown) = equilibrium_for_display(equations, x, target.motions, &d, step)? {
                    return Ok(Equilibrium { iterations: iteration + 1, ..shown });
                }
            }
            Err(no_step) => {
                equations.state.records.push(record);
                if let Some(safer) = choice.kind.safer(has_springs).filter(|_| !limits.linear) {
                    choice.kind = safer;
                    equations.work.solver_mut().refresh();
                    continue;
                }
                let here = ResidualTest { residual_n: balance.residual_n, ..last };
                return Err(no_step_failure(no_step, here, iteration + 1));
            }
        }
    }
    let ResidualTest { residual_n, tolerance_n } = last;
    Err(Failure::NotConverged { iterations: limits.max_iterations, residual_n, tolerance_n })
}

impl ResidualTest {
    fn of(balance: &Balance, aim: f64, limits: &Limits) -> Self {
        let tolerance_n = aim * balance.reaction_n.max(limits.force_floor_n);
        Self { residual_n: balance.residual_n, tolerance_n }
    }

    fn is_met(self) -> bool {
        self.residual_n <= self.tolerance_n
    }
}

impl ModelChoice {
    /// The choice before the first iteration.
    fn first() -> Self {
        let terms = CurvatureTerms { after_condensed: true, ..CurvatureTerms::default() };
        Self { kind: TangentKind::Exact, terms, wait: 0, moved_mm: f64::INFINITY }
    }

    /// The choice after the share `step` of a Newton step has been taken.
    fn update(&mut self, step: f64, record: &IterationRecord) {
        self.moved_mm = record.displacement_mm;
        // A short step shows that the quadratic model was poor.
        self.kind = if step < POOR_STEP { TangentKind::Projected } else { TangentKind::Exact };
        self.wait = if record.unstable { ITERATIONS_WITHOUT_CURVATURE } else { self.wait.saturating_sub(1) };
        self.terms.after_condensed = self.wait == 0;
        self.terms.share = match record.displacement_mm {
            _ if self.wait > 0 || step < 1.0 => 0.0,
            moved if moved < WHOLE_CURVATURE_BELOW_MM => 1.0,
            moved if moved < PART_CURVATURE_BELOW_MM => PART_CURVATURE_SHARE,
            _ => 0.0,
        };
    }
}

/// Relative tolerance of the linear system. Inexact Newton: it is solved only as accurately as the next residual needs.
fn forcing(balance: &Balance, test: ResidualTest, limits: &Limits) -> f64 {
    let [least, most] = FORCING_RANGE;
    (FORCING * balance.residual_n / balance.reaction_n.max(limits.force_floor_n))
        .max(FORCING_AT_END * test.tolerance_n / balance.residual_n)
        .clamp(least, most)
}

fn record_of(t: f64, balance: &Balance) -> IterationRecord {
    IterationRecord {
        t,
        residual_n: balance.residual_n,
        reaction_n: balance.reaction_n,
        active_contacts: balance.contacts.len(),
        ..IterationRecord::default()
    }
}

/// Share of the step `d` that the line search takes.
fn step_along(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    d: &[f64],
    balance: &Balance,
    record: &IterationRecord,
) -> Result<f64, NoStep> {
    let slope = dot(d, equations.work.residual());
    let (begin, before) = (equations.problem.now(), equations.work.times().total_s());
    let start =
        Start { energy: balance.energy, slope, depth: penetration(&balance.contacts), unstable: record.unstable };
    let taken = line_search::search(equations, x, motions, d, &start);
    let others = equations.work.times().total_s() - before;
    equations.work.times_mut().line_search_s += equations.problem.now() - begin - others;
    taken
}

/// Moves `x` and records the iteration.
fn take_step(
    equations: &mut Equations<'_>,
    x: &mut [Vector],
    motions: &[Motion],
    d: &[f64],
    step: f64,
    record: &mut IterationRecord,
    choice: &mut ModelChoice,
) {
    x.copy_from_slice(&equations.moved(x, motions, step, d));
    let dofs = equations.problem.dofs();
    record.step = step;
    record.displacement_mm = step * dofs.max_position_change(d);
    equations.state.uses_condensed &= record.displacement_mm <= CONDENSED_MAX_RATIO * choice.moved_mm;
    choice.update(step, record);
    equations.state.records.push(*record);
}

/// The equilibrium after a step that suffices for display, without its number of iterations.
fn equilibrium_for_display(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    d: &[f64],
    step: f64,
) -> Result<Option<Equilibrium>, Failure> {
    let remaining_mm = equations.problem.dofs().max_visible_change(d);
    let suffices = equations.state.purpose == Purpose::Display && step >= 1.0 && remaining_mm <= DISPLAY_STEP_MM;
    if !suffices {
        return Ok(None);
    }
    let balance = equations.balance(x, motions)?;
    let reaction_n = balance.reaction_n.max(equations.problem.limits().force_floor_n);
    let relative_residual = balance.residual_n / reaction_n;
    Ok(Some(Equilibrium { iterations: 0, remaining_mm, relative_residual, contacts: balance.contacts }))
}

fn no_step_failure(
    no_step: NoStep,
    ResidualTest { residual_n, tolerance_n }: ResidualTest,
    iterations: usize,
) -> Failure {
    match no_step {
        NoStep::Inverted(at) => Failure::Inverted(at),
        NoStep::Cancelled => Failure::Cancelled,
        NoStep::NoDescent => Failure::NotConverged { iterations, residual_n, tolerance_n },
    }
}

/// A descent direction: the Newton step with the requested tangent, or with a safer one when that tangent is not positive
/// definite. Multipliers may grow meanwhile, so the balance at `x` is returned with the updated ones.
fn direction(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    mut balance: Balance,
    choice: &mut ModelChoice,
    forcing: f64,
    record: &mut IterationRecord,
) -> Result<Direction, Failure> {
    let linear = equations.problem.limits().linear;
    let has_springs = !equations.state.springs.is_empty();
    let mut assembled = None;
    loop {
        if assembled != Some(choice.kind) {
            equations.tangent(x, motions, choice.kind)?;
            assembled = Some(choice.kind);
        }
        let mut load = equations.work.forces().to_vec();
        equations.subtract_loads(&mut load);
        let goal = Goal { x, motions, load: &load, forcing };
        let found = minimise_model(equations, goal, &mut choice.terms, record);
        if !equations.state.contact.is_empty() {
            balance = equations.balance_of(balance.elastic, x, motions);
        }
        match found {
            Ok(d) => {
                record.projected = choice.kind != TangentKind::Exact;
                if dot(&d, equations.work.residual()) < 0.0 {
                    return Ok(Direction { d, balance });
                }
            }
            Err(Failure::Cancelled) => return Err(Failure::Cancelled),
            // A safer kind of tangent follows.
            Err(_) => {}
        }
        if choice.terms.used {
            choice.terms = CurvatureTerms::default();
            record.unstable = true;
            continue;
        }
        let solver = equations.work.solver_mut();
        if let Some(safer) = choice.kind.safer(has_springs).filter(|_| !linear) {
            choice.kind = safer;
            record.unstable = true;
            // The last kind is positive definite: when its factorisation fails, the precision was too low.
        } else if solver.is_double() {
            return Err(Failure::Indefinite);
        } else {
            solver.use_double();
        }
        solver.refresh();
    }
}
