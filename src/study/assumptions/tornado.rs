//! The tornado chart: one bar for each choice, the most important on top.

use plotters::prelude::*;

use super::Row;
use crate::error::BenchError;

const WIDTH: u32 = 1000;
const ROW_PX: u32 = 22;

/// One bar: mean over heads and operations.
struct Bar {
    choice: &'static str,
    mean_mm: f64,
    p95_mm: f64,
    /// Mean of the region that changes most, and its name.
    worst: (f64, &'static str),
}

/// Draws the chart of all rows that have a result.
pub(super) fn draw(rows: &[Row]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, &bars(rows)).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn bars(rows: &[Row]) -> Vec<Bar> {
    let mut names: Vec<&'static str> = Vec::new();
    for row in rows.iter().filter(|r| r.choice != "as usual" && r.fault.is_empty()) {
        if !names.contains(&row.choice) {
            names.push(row.choice);
        }
    }
    let mean = |choice: &str, region: &str, value: fn(&Row) -> f64| {
        let all: Vec<f64> = (rows.iter())
            .filter(|r| r.choice == choice && r.region == region && r.fault.is_empty())
            .map(value)
            .collect();
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    let regions: std::collections::BTreeSet<&'static str> =
        rows.iter().map(|r| r.region).filter(|r| *r != "face").collect();
    let mut bars: Vec<Bar> = (names.iter())
        .map(|choice| Bar {
            choice,
            mean_mm: mean(choice, "face", |r| r.mean_mm),
            p95_mm: mean(choice, "face", |r| r.p95_mm),
            worst: (regions.iter().map(|region| (mean(choice, region, |r| r.mean_mm), *region)))
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or((0.0, "")),
        })
        .collect();
    bars.sort_by(|a, b| b.p95_mm.total_cmp(&a.p95_mm));
    bars
}

fn drawn(svg: &mut String, bars: &[Bar]) -> Result<(), String> {
    let said = |e: DrawingAreaErrorKind<_>| e.to_string();
    let height = 130 + ROW_PX * bars.len().max(1) as u32;
    let root = SVGBackend::with_string(svg, (WIDTH, height)).into_drawing_area();
    root.fill(&WHITE).map_err(said)?;
    let most = bars.iter().map(|b| b.p95_mm).fold(0.1, f64::max);
    let lines = bars.len().max(1) as f64;
    let mut chart = ChartBuilder::on(&root)
        .caption("How far the face moves when one choice is changed", ("sans-serif", 20))
        .margin(16)
        .margin_right(190)
        .x_label_area_size(48)
        .y_label_area_size(220)
        .build_cartesian_2d(0.0..1.05 * most, lines..0.0)
        .map_err(said)?;
    chart
        .configure_mesh()
        .x_desc(
            "mean (dark) and 95th percentile (light) over the moved skin, mm; right: region that changes most, mean",
        )
        .axis_desc_style(("sans-serif", 15))
        .label_style(("sans-serif", 13))
        .disable_y_mesh()
        .y_labels(0)
        .max_light_lines(1)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()
        .map_err(said)?;
    for (n, bar) in bars.iter().enumerate() {
        let y = n as f64;
        let rectangle =
            |length: f64, color: RGBColor| Rectangle::new([(0.0, y + 0.15), (length, y + 0.85)], color.filled());
        let both = [rectangle(bar.p95_mm, RGBColor(170, 205, 235)), rectangle(bar.mean_mm, RGBColor(0, 114, 178))];
        chart.draw_series(both).map_err(said)?;
        let name = Text::new(bar.choice, (-212, -7), ("sans-serif", 13));
        chart.draw_series([EmptyElement::at((0.0, y + 0.5)) + name]).map_err(said)?;
        let (mm, region) = bar.worst;
        let worst = Text::new(format!("{} {mm:.2}", region.replace('_', " ")), (8, -7), ("sans-serif", 13));
        chart.draw_series([EmptyElement::at((1.05 * most, y + 0.5)) + worst]).map_err(said)?;
    }
    root.present().map_err(said)
}
