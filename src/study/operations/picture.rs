//! The chart of solve times.

use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::prelude::*;

use super::{End, GOALS, Row};
use crate::error::BenchError;

const WIDTH: u32 = 1100;
const ROW_PX: u32 = 17;
/// Height of the legend below the plot.
const LEGEND_PX: u32 = 30;

fn color(end: End) -> RGBColor {
    match end {
        End::Relied => RGBColor(0, 114, 178),
        End::Refused => RGBColor(150, 150, 150),
        End::Doubtful => RGBColor(230, 159, 0),
        End::Failed | End::Overdue => RGBColor(213, 94, 0),
    }
}

/// Draws the solve times: one line per operation, one mark per head and model, coloured by the result.
pub(super) fn of_times(rows: &[Row]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, rows).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn(svg: &mut String, rows: &[Row]) -> Result<(), String> {
    let mut names: Vec<&str> = Vec::new();
    for row in rows {
        if !names.contains(&row.operation.as_str()) {
            names.push(&row.operation);
        }
    }
    if names.is_empty() {
        return Err("nothing to draw".to_owned());
    }
    let said = |e: DrawingAreaErrorKind<_>| e.to_string();
    let slowest = rows.iter().map(|r| r.solve_s).fold(GOALS.1, f64::max);
    let height = 150 + LEGEND_PX + ROW_PX * names.len() as u32;
    let root = SVGBackend::with_string(svg, (WIDTH, height)).into_drawing_area();
    root.fill(&WHITE).map_err(said)?;
    let lines = names.len() as f64;
    let solved = rows.iter().filter(|r| r.end != End::Refused).map(|r| r.solve_s);
    let quickest = solved.fold(GOALS.2, f64::min).max(0.1);
    let (low, high) = (0.5 * quickest, 1.5 * slowest);
    let seconds =
        [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0, 300.0, 600.0].into_iter().filter(|t| (low..high).contains(t));
    let (plot, _) = root.split_vertically(height - LEGEND_PX);
    let mut chart = ChartBuilder::on(&plot)
        .caption("Time of a solve, one mark per head and model", ("sans-serif", 20))
        .margin(16)
        .x_label_area_size(52)
        .y_label_area_size(220)
        .build_cartesian_2d((low..high).log_scale().with_key_points(seconds.collect()), lines..0.0)
        .map_err(said)?;
    chart
        .configure_mesh()
        .x_desc("wall time, s; vertical lines: goals for the median and the slowest solve")
        .axis_desc_style(("sans-serif", 15))
        .label_style(("sans-serif", 13))
        .disable_y_mesh()
        .y_labels(0)
        .max_light_lines(1)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()
        .map_err(said)?;
    for goal in [GOALS.2, GOALS.1] {
        let line = PathElement::new([(goal, 0.0), (goal, lines)], BLACK.mix(0.5).stroke_width(1));
        chart.draw_series([line]).map_err(said)?;
    }
    for (n, name) in names.iter().enumerate() {
        let middle = n as f64 + 0.5;
        let word = Text::new((*name).to_owned(), (-215, -7), ("sans-serif", 13));
        chart.draw_series([EmptyElement::at((low, middle)) + word]).map_err(said)?;
        let own = rows.iter().filter(|r| r.operation == *name && r.end != End::Refused);
        let marks = own.map(|r| Circle::new((r.solve_s.max(low), middle), 4, color(r.end).filled()));
        chart.draw_series(marks).map_err(said)?;
        let refused = rows.iter().filter(|r| r.operation == *name && r.end == End::Refused).count();
        let refusals =
            (0..refused).map(|i| Cross::new((low * 1.08f64.powi(i as i32 + 1), middle), 3, color(End::Refused)));
        chart.draw_series(refusals).map_err(said)?;
    }
    let legend = [
        (End::Relied, "reliable"),
        (End::Doubtful, "reported as unreliable"),
        (End::Failed, "failed or over the time limit"),
        (End::Refused, "refused before the solve (cross at the left)"),
    ];
    let mut x = 230;
    for (end, words) in legend {
        let y = height as i32 - 14;
        root.draw(&Circle::new((x, y), 4, color(end).filled())).map_err(said)?;
        root.draw(&Text::new(words, (x + 9, y - 7), ("sans-serif", 13))).map_err(said)?;
        x += 40 + 7 * words.len() as i32;
    }
    root.present().map_err(said)
}
