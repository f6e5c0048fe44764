//! How often `auto` keeps a budget in the scenes of a study, which should not be those of its fit.

use std::io::Write;

use super::super::error::BenchError;
use super::fit::quantile;
use super::{Row, demand_of};
use prosopon_planning::simulate::budget::{
    Choice, Demand, Limits, Tried, choose, choose_after, error_from_distance, settings,
};

/// Errors that are asked for in every scene, mm.
const ASKED_MM: [f64; 6] = [1.0, 0.7, 0.5, 0.3, 0.2, 0.1];
/// An estimate may be off by this factor.
const ESTIMATE: f64 = 2.0;
/// A choice may take this many times as long as the fastest setting that keeps the budget.
const SLOWER: f64 = 1.3;

/// Counts over all scenes and asked errors.
#[derive(Default)]
struct Counts {
    asked: usize,
    /// Jobs in all.
    jobs: usize,
    /// The last job's estimate is within the asked error.
    claimed: usize,
    /// Its true error is, too.
    kept: usize,
    fast: usize,
    /// Of those that were not claimed, those that no setting of the study keeps.
    rightly: usize,
    estimates: usize,
    close: usize,
}

/// Prints how often the error was kept, the estimate close and the choice fast.
pub(super) fn print(rows: &[Row], out: &mut dyn Write) -> Result<(), BenchError> {
    let (mut c, mut ratios) = (Counts::default(), Vec::new());
    for scene in rows.chunk_by(|a, b| (&a.head, &a.operation) == (&b.head, &b.operation)) {
        ASKED_MM.iter().for_each(|asked| count(scene, *asked, &mut c));
        for row in scene.iter().filter(|r| r.error_mm.is_finite()) {
            let Some(estimate_mm) = estimated(row) else { continue };
            c.estimates += 1;
            c.close += usize::from((1.0 / ESTIMATE..=ESTIMATE).contains(&(estimate_mm / row.error_mm)));
            ratios.extend(once_estimated(row, estimate_mm, scene));
        }
    }
    writeln!(
        out,
        "  {} asked errors, {} jobs: said to be kept {}, and kept {}, within {SLOWER} times the fastest {}; of the others {} of {} \
         were out of reach; estimate within a factor of {ESTIMATE} {} of {}",
        c.asked,
        c.jobs,
        c.claimed,
        c.kept,
        c.fast,
        c.rightly,
        c.asked - c.claimed,
        c.close,
        c.estimates
    )?;
    let most = quantile(ratios, 0.95);
    writeln!(out, "  error of another setting, by the estimate of one: 95 % below {most:.2} times the expected one")?;
    Ok(())
}

fn estimated(row: &Row) -> Option<f64> {
    row.to_coarser_mm.is_finite().then(|| error_from_distance(row.to_coarser_mm, row.locking))
}

/// Errors of all better settings, in units of what the law and the estimate of `row` lead to expect.
fn once_estimated(row: &Row, estimate_mm: f64, scene: &[Row]) -> Vec<f64> {
    let law = |r: &Row| {
        let given = Demand { edge_mm: Some(r.edge_mm), locking: Some(r.locking), ..demand_of(r) };
        settings(&given).first().map_or(f64::NAN, |s| s.error_mm)
    };
    let better = scene.iter().filter(|r| law(r) < law(row) && r.error_mm.is_finite());
    better.map(|r| r.error_mm / (estimate_mm * law(r) / law(row))).collect()
}

/// Follows `auto` from its first choice until its estimate keeps the asked error or nothing better is left.
fn count(scene: &[Row], asked_mm: f64, counts: &mut Counts) {
    let limits = Limits { error_mm: Some(asked_mm), wall_s: None };
    // Before the first mesh only the plan is known.
    let first = scene.first().map(|row| Demand { mesh: None, ..demand_of(row) });
    let Some(mut choice) = first.and_then(|demand| choose(&demand, limits)) else { return };
    // A setting of another edge than the study's cannot be checked.
    let row_of = |choice: &Choice| {
        let is_chosen = |r: &&Row| r.edge_mm == choice.chosen.edge_mm && r.locking == choice.chosen.locking;
        scene.iter().find(is_chosen)
    };
    let wall_s = |r: &Row| r.mesh_s + r.solve_s;
    let mut spent_s = 0.0;
    counts.asked += 1;
    let (row, claimed) = loop {
        let Some(row) = row_of(&choice) else { return };
        counts.jobs += 1;
        spent_s += wall_s(row);
        let Some(error_mm) = estimated(row) else { break (row, false) };
        if error_mm <= asked_mm {
            break (row, true);
        }
        let tried = Tried { edge_mm: row.edge_mm, locking: row.locking, error_mm, path_s: row.solve_s };
        match choose_after(&tried, &demand_of(row), limits) {
            Some(better) => choice = better,
            None => break (row, false),
        }
    };
    let fastest_s = scene.iter().filter(|r| r.error_mm <= asked_mm).map(wall_s).fold(f64::INFINITY, f64::min);
    if !claimed {
        counts.rightly += usize::from(fastest_s.is_infinite());
        return;
    }
    counts.claimed += 1;
    if row.error_mm <= asked_mm {
        counts.kept += 1;
        counts.fast += usize::from(spent_s <= SLOWER * fastest_s);
    }
}
