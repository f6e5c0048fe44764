//! The chart of ratios.

use plotters::prelude::*;

use super::Row;
use crate::error::BenchError;

const WIDTH: u32 = 1000;
const ROW_PX: u32 = 26;
const LEGEND_PX: u32 = 30;
/// Colours of Okabe and Ito, which colour-blind readers can distinguish; one for each head.
const HEADS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// Draws the ratios: one line for each measure with its published range as a bar, one mark for each head.
pub(super) fn of_ratios(rows: &[Row]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, rows).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn(svg: &mut String, rows: &[Row]) -> Result<(), String> {
    let said = |e: DrawingAreaErrorKind<_>| e.to_string();
    let mut lines: Vec<(&str, &str, [f64; 2])> = Vec::new();
    let mut heads: Vec<&str> = Vec::new();
    for row in rows {
        let Some(range) = row.published else { continue };
        let line = (row.operation.as_str(), row.measure.as_str(), range);
        if !lines.contains(&line) {
            lines.push(line);
        }
        if !heads.contains(&row.head.as_str()) {
            heads.push(&row.head);
        }
    }
    if lines.is_empty() {
        return Err("nothing to draw".to_owned());
    }
    let values = rows.iter().filter(|r| r.published.is_some()).filter_map(Row::judged);
    let (low, high) = values.fold((-0.1f64, 1.2f64), |(low, high), v| (low.min(v - 0.05), high.max(v + 0.05)));
    let n = lines.len() as f64;
    let height = 130 + ROW_PX * lines.len() as u32;
    let root = SVGBackend::with_string(svg, (WIDTH, height + LEGEND_PX)).into_drawing_area();
    root.fill(&WHITE).map_err(said)?;
    let (above, below) = root.split_vertically(height);
    let mut chart = ChartBuilder::on(&above)
        .caption("Soft-to-hard ratios; grey: published range (up: wanted)", ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(52)
        .y_label_area_size(330)
        .build_cartesian_2d(low..high, n..0.0)
        .map_err(said)?;
    chart
        .configure_mesh()
        .x_desc(
            "movement of the soft point along its hard point's, as a share; `up`: upwards, as a share of the advance",
        )
        .axis_desc_style(("sans-serif", 14))
        .label_style(("sans-serif", 13))
        .disable_y_mesh()
        .y_labels(0)
        .max_light_lines(1)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()
        .map_err(said)?;
    for (i, (operation, measure, [from, to])) in lines.iter().enumerate() {
        let middle = i as f64 + 0.5;
        let bar = Rectangle::new([(*from, middle - 0.3), (*to, middle + 0.3)], RGBColor(205, 205, 205).filled());
        chart.draw_series([bar]).map_err(said)?;
        let word = Text::new(format!("{operation}: {measure}"), (-325, -7), ("sans-serif", 13));
        chart.draw_series([EmptyElement::at((low, middle)) + word]).map_err(said)?;
        let own = rows.iter().filter(|r| (r.operation.as_str(), r.measure.as_str()) == (*operation, *measure));
        let marks = own.filter_map(|r| {
            let color = heads.iter().position(|h| *h == r.head).and_then(|h| HEADS.get(h % HEADS.len()))?;
            Some(Circle::new((r.judged()?, middle), 4, color.filled()))
        });
        chart.draw_series(marks).map_err(said)?;
    }
    let mut x = 340;
    for (h, name) in heads.iter().enumerate() {
        let color = HEADS.get(h % HEADS.len()).copied().unwrap_or(BLACK);
        below.draw(&Circle::new((x, 10), 4, color.filled())).map_err(said)?;
        below.draw(&Text::new((*name).to_owned(), (x + 9, 3), ("sans-serif", 13))).map_err(said)?;
        x += 40 + 7 * name.len() as i32;
    }
    root.present().map_err(said)
}
