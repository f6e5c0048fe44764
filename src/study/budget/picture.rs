//! Time against error, and where `auto` lies.

use plotters::style::RGBColor;

use super::super::chart::{self, Curve, Labels};
use super::super::error::BenchError;
use super::super::model_case::locking_name;
use super::{LOCKINGS, Row, demand_of};
use prosopon_planning::simulate::budget::{Limits, choose};

/// Colours of plain and patched elements by head (Okabe and Ito).
const COLOURS: [[RGBColor; 2]; 3] = [
    [RGBColor(230, 159, 0), RGBColor(213, 94, 0)],
    [RGBColor(86, 180, 233), RGBColor(0, 114, 178)],
    [RGBColor(0, 158, 115), RGBColor(0, 90, 60)],
];
/// Errors asked of `auto` that are drawn, mm.
const ASKED_MM: [f64; 3] = [1.0, 0.5, 0.3];

/// Draws a curve for each head and formulation, and the choices of `auto` for the last head.
pub(super) fn draw(rows: &[Row]) -> Result<String, BenchError> {
    let mut curves = Vec::new();
    let heads = rows.chunk_by(|a, b| a.head == b.head);
    for (of_head, colours) in heads.zip(COLOURS.iter().cycle()) {
        let Some(first) = of_head.first() else { continue };
        for (locking, color) in LOCKINGS.into_iter().zip(colours) {
            let mut edges: Vec<f64> = of_head.iter().map(|r| r.edge_mm).collect();
            edges.sort_unstable_by(|a, b| b.total_cmp(a));
            edges.dedup();
            let at = |edge: &f64| {
                let own = of_head.iter().filter(|r| r.locking == locking && r.edge_mm == *edge);
                mean_point(own).map(|point| (point, format!("{edge}")))
            };
            let (points, marks) = edges.iter().filter_map(at).unzip();
            let name = format!("{}, {}", first.head, locking_name(locking));
            curves.push(Curve { name, color: *color, points, marks });
        }
        let asked = |asked_mm: &f64| {
            let chosen = of_head.chunk_by(|a, b| a.operation == b.operation).filter_map(|scene| {
                let limits = Limits { error_mm: Some(*asked_mm), wall_s: None };
                let setting = choose(&demand_of(scene.first()?), limits)?.chosen;
                scene.iter().find(|r| r.edge_mm == setting.edge_mm && r.locking == setting.locking)
            });
            mean_point(chosen).map(|point| (point, format!("auto {asked_mm}")))
        };
        let (points, marks) = ASKED_MM.iter().filter_map(asked).unzip();
        let name = format!("{}, auto", first.head);
        curves.push(Curve { name, color: RGBColor(0, 0, 0), points, marks });
    }
    let labels = Labels {
        title: "Time against error, mean over the operations",
        x: "error, mm: P95 over the moving face, to patched elements of 3 mm (labels: edge, or the error asked of auto, mm)",
        y: "mesh and path, s",
    };
    chart::draw(&labels, &curves)
}

/// Geometric means of error and time; `None` without a solved row.
fn mean_point<'a>(rows: impl Iterator<Item = &'a Row>) -> Option<(f64, f64)> {
    let logs: Vec<[f64; 2]> =
        rows.filter(|r| r.error_mm > 0.0).map(|r| [r.error_mm.ln(), (r.mesh_s + r.solve_s).ln()]).collect();
    let mean = |k: usize| (logs.iter().map(|l| l[k]).sum::<f64>() / logs.len() as f64).exp();
    (!logs.is_empty()).then(|| (mean(0), mean(1)))
}
