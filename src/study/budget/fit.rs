//! Power laws through the rows of the study.

use std::io::Write;

use super::super::error::BenchError;
use super::super::model_case::locking_name;
use super::{LOCKINGS, Row};

/// Edge length at which the factors of the laws are given, mm.
const EDGE_MM: f64 = 4.0;
/// Nodes at which the factors of the times are given.
const NODES: f64 = 10_000.0;

/// `y = factor * x ^ exponent`, fitted to the logarithms.
struct Law {
    factor: f64,
    exponent: f64,
    /// The law times this holds for 95 % of the points.
    spread: f64,
}

impl Law {
    /// The law through points with positive coordinates; `None` through fewer than two different x.
    fn through(points: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let logs: Vec<(f64, f64)> = points.filter(|(_, y)| *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
        let n = logs.len() as f64;
        let mean = |of: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        let (xx, xy) = (mean(&|p| (p.0 - x).powi(2)), mean(&|p| (p.0 - x) * (p.1 - y)));
        let exponent = xy / xx;
        let law = (y - exponent * x).exp();
        let off = logs.iter().map(|p| (p.1 - law.ln() - exponent * p.0).exp()).collect();
        exponent.is_finite().then(|| Self { factor: law, exponent, spread: quantile(off, 0.95) })
    }
}

/// The value that a share `q` of the values does not exceed; NaN without values.
pub(super) fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    values.get((q * last).ceil() as usize).copied().unwrap_or(f64::NAN)
}

/// Prints the laws of each formulation.
pub(super) fn print(rows: &[Row], out: &mut dyn Write) -> Result<(), BenchError> {
    let line = |name: &str, law: Option<Law>| match law {
        Some(Law { factor, exponent, spread }) => {
            format!("  {name:<42} {factor:.4} x^{exponent:.2}, 95 % below {spread:.2} times that")
        }
        None => format!("  {name:<42} too few rows"),
    };
    writeln!(
        out,
        "{}",
        line("nodes by edge / 4 mm", Law::through(rows.iter().map(|r| (r.edge_mm / EDGE_MM, r.nodes as f64))))
    )?;
    writeln!(
        out,
        "{}",
        line("mesh, s, by nodes / 10 000", Law::through(rows.iter().map(|r| (r.nodes as f64 / NODES, r.mesh_s))))
    )?;
    for locking in LOCKINGS {
        let of: Vec<&Row> = rows.iter().filter(|r| r.locking == locking).collect();
        let done = || of.iter().filter(|r| r.fault.is_empty());
        let name = locking_name(locking);
        let error = done().map(|r| (r.edge_mm / EDGE_MM, r.error_mm / r.displacement_mm));
        writeln!(out, "{}", line(&format!("{name}: error per mm, by edge / 4 mm"), Law::through(error)))?;
        let time = done().map(|r| (r.nodes as f64 / NODES, r.solve_s));
        writeln!(out, "{}", line(&format!("{name}: solve, s, by nodes / 10 000"), Law::through(time)))?;
        let ratios: Vec<f64> = done().map(|r| r.error_mm / r.to_coarser_mm).filter(|r| r.is_finite()).collect();
        let [low, median, high] = [0.05, 0.5, 0.95].map(|q| quantile(ratios.clone(), q));
        let failed = of.len() - done().count();
        writeln!(
            out,
            "  {name}: error / distance to the next coarser mesh {low:.2}, {median:.2}, {high:.2} (5, 50, 95 %); {failed} of {} failed",
            of.len()
        )?;
    }
    Ok(())
}
