//! How often the table of `auto` keeps a budget in the scenes of a study, which should not be those of its fit.

use std::io::Write;

use super::super::error::BenchError;
use super::{Row, demand_of};
use prosopon_planning::simulate::budget::{Grounds, Limits, choose, error_from_distance};

/// Errors that are asked for in every scene, mm.
const ASKED_MM: [f64; 6] = [1.0, 0.7, 0.5, 0.3, 0.2, 0.1];
/// An estimate may be off by this factor.
const ESTIMATE: f64 = 2.0;
/// A choice may take this many times as long as the fastest setting that keeps the budget.
const SLOWER: f64 = 1.3;

/// Counts over all scenes and asked errors.
#[derive(Default)]
struct Counts {
    promised: usize,
    kept: usize,
    fast: usize,
    declined: usize,
    rightly: usize,
    estimates: usize,
    close: usize,
}

/// Prints how often the error was kept, the estimate close and the choice fast.
pub(super) fn print(rows: &[Row], out: &mut dyn Write) -> Result<(), BenchError> {
    let mut counts = Counts::default();
    for scene in rows.chunk_by(|a, b| (&a.head, &a.operation) == (&b.head, &b.operation)) {
        ASKED_MM.iter().for_each(|asked| count(scene, *asked, &mut counts));
        let both = scene.iter().filter(|r| r.error_mm.is_finite() && r.to_coarser_mm.is_finite());
        for row in both {
            let off = error_from_distance(row.to_coarser_mm, row.locking) / row.error_mm;
            counts.estimates += 1;
            counts.close += usize::from((1.0 / ESTIMATE..=ESTIMATE).contains(&off));
        }
    }
    let c = counts;
    writeln!(
        out,
        "  promised error kept {} of {}; within {SLOWER} times the fastest {} of {}; rightly declined {} of {}; estimate within a \
         factor of {ESTIMATE} {} of {}",
        c.kept, c.promised, c.fast, c.kept, c.rightly, c.declined, c.close, c.estimates
    )?;
    Ok(())
}

fn count(scene: &[Row], asked_mm: f64, counts: &mut Counts) {
    let Some(demand) = scene.first().map(demand_of) else { return };
    let Some(choice) = choose(&demand, Limits { error_mm: Some(asked_mm), wall_s: None }) else { return };
    let wall_s = |r: &Row| r.mesh_s + r.solve_s;
    let keeps = || scene.iter().filter(|r| r.error_mm <= asked_mm);
    let fastest_s = keeps().map(wall_s).fold(f64::INFINITY, f64::min);
    if choice.grounds != Grounds::Fastest {
        counts.declined += 1;
        counts.rightly += usize::from(fastest_s.is_infinite());
        return;
    }
    // A setting of another edge than the study's cannot be checked.
    let is_chosen = |r: &&Row| r.edge_mm == choice.chosen.edge_mm && r.locking == choice.chosen.locking;
    let Some(row) = scene.iter().find(is_chosen) else { return };
    counts.promised += 1;
    if row.error_mm <= asked_mm {
        counts.kept += 1;
        counts.fast += usize::from(wall_s(row) <= SLOWER * fastest_s);
    }
}
