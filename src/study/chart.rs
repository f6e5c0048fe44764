//! SVG charts of curves over logarithmic or linear axes.

use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::prelude::*;

use super::error::BenchError;
use super::row::{Builder, Row};
use prosopon_field::Method;

const SIZE: (u32, u32) = (900, 560);
/// Width of the legend on the right, pixels.
const LEGEND: u32 = 220;

/// One curve.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) color: RGBColor,
    /// Points (x, y); logarithmic axes need positive coordinates.
    pub(super) points: Vec<(f64, f64)>,
    /// Labels of the first points, in the same order.
    pub(super) marks: Vec<String>,
}

/// Title and axes.
pub(super) struct Labels<'a> {
    pub(super) title: &'a str,
    pub(super) x: &'a str,
    pub(super) y: &'a str,
}

/// Draws the charts of the field study; returns the suffix of each file name and the SVG.
///
/// The charts show the memory of a field and its build time, each against the largest error and the RMS error.
pub(super) fn of_fields(rows: &[Row]) -> Result<Vec<(&'static str, String)>, BenchError> {
    let largest = ("largest measured error", "largest error in the band, mm");
    let mean = ("RMS error", "RMS error in the band, mm");
    let memory = ("Memory of a distance field against its", "memory of the field, MB");
    let time = ("Time to build a distance field against its", "build, s");
    let charts: [(&str, Axis, Axis); 4] = [
        ("memory", (memory, |r| r.timing.memory_mb), (largest, |r| r.accuracy.max_error_mm)),
        ("time", (time, |r| r.timing.build_wall_s), (largest, |r| r.accuracy.max_error_mm)),
        ("memory-rms", (memory, |r| r.timing.memory_mb), (mean, |r| r.accuracy.rms_error_mm)),
        ("time-rms", (time, |r| r.timing.build_wall_s), (mean, |r| r.accuracy.rms_error_mm)),
    ];
    charts
        .into_iter()
        .map(|(name, ((what, y), up), ((against, x), across))| {
            let title = format!("{what} {against}");
            let labels = Labels { title: &title, x, y };
            Ok((name, draw(&labels, &by_builder(rows, across, up))?))
        })
        .collect()
}

/// Texts of an axis (in the title, along the axis) and the value it shows.
type Axis = ((&'static str, &'static str), fn(&Row) -> f64);

fn by_builder(rows: &[Row], x: fn(&Row) -> f64, y: fn(&Row) -> f64) -> Vec<Curve> {
    let curve = |builder: Builder| {
        let mut points: Vec<(f64, f64)> =
            rows.iter().filter(|r| r.case.builder == builder).map(|r| (x(r), y(r))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let color = match builder {
            Builder::Ours(method) => color(method),
            Builder::OpenVdb => RGBColor(86, 180, 233),
        };
        Curve { name: builder.name().to_owned(), color, points, marks: Vec::new() }
    };
    Builder::all().map(curve).collect()
}

/// Colours of Okabe and Ito, which colour-blind readers can distinguish.
pub(super) fn color(method: Method) -> RGBColor {
    match method {
        Method::Uniform => RGBColor(230, 159, 0),
        Method::Frisken => RGBColor(0, 158, 115),
        Method::Hybrid => RGBColor(0, 114, 178),
        Method::Adaptive => RGBColor(213, 94, 0),
    }
}

/// Draws curves over logarithmic axes.
pub(super) fn draw(labels: &Labels, curves: &[Curve]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, labels, curves).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn(svg: &mut String, labels: &Labels, curves: &[Curve]) -> Result<(), String> {
    let points = || curves.iter().flat_map(|c| c.points.iter());
    let x = span(points().map(|p| p.0)).ok_or("nothing to draw")?;
    let y = span(points().map(|p| p.1)).ok_or("nothing to draw")?;
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE).map_err(|e| e.to_string())?;
    let mut chart = ChartBuilder::on(&root)
        .caption(labels.title, ("sans-serif", 20))
        .margin(16)
        .margin_right(LEGEND)
        .x_label_area_size(52)
        .y_label_area_size(76)
        .build_cartesian_2d(
            (x.0..x.1).log_scale().with_key_points(ticks(x)),
            (y.0..y.1).log_scale().with_key_points(ticks(y)),
        )
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(labels.x)
        .y_desc(labels.y)
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 14))
        .x_label_formatter(&short)
        .y_label_formatter(&short)
        .max_light_lines(1)
        .bold_line_style(RGBColor(220, 220, 220))
        .draw()
        .map_err(|e| e.to_string())?;
    let shown = curves.iter().filter(|c| !c.points.is_empty());
    for (n, curve) in shown.enumerate() {
        // Earlier curves are wider, so that they remain visible below later ones.
        let wide = 4u32.saturating_sub(n as u32);
        let line = curve.color.stroke_width(2 + wide);
        chart.draw_series(LineSeries::new(curve.points.iter().copied(), line)).map_err(|e| e.to_string())?;
        let dots = curve.points.iter().map(|&p| Circle::new(p, 4 + wide, curve.color.filled()));
        chart.draw_series(dots).map_err(|e| e.to_string())?;
        let marks = curve.points.iter().zip(&curve.marks).map(|(&point, mark)| {
            let word = Text::new(mark.clone(), (8, 2), ("sans-serif", 13).into_font().color(&curve.color));
            EmptyElement::at(point) + word
        });
        chart.draw_series(marks).map_err(|e| e.to_string())?;
        // The legend is beside the plot, so that it covers no curve.
        let (left, middle) = ((SIZE.0 - LEGEND) as i32 + 12, 64 + 26 * n as i32);
        root.draw(&PathElement::new([(left, middle), (left + 22, middle)], line)).map_err(|e| e.to_string())?;
        let name = Text::new(curve.name.clone(), (left + 30, middle - 8), ("sans-serif", 16));
        root.draw(&name).map_err(|e| e.to_string())?;
    }
    root.present().map_err(|e| e.to_string())
}

/// Draws curves over linear axes that begin at 0.
pub(super) fn draw_linear(labels: &Labels, curves: &[Curve]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn_linear(&mut svg, labels, curves).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn_linear(svg: &mut String, labels: &Labels, curves: &[Curve]) -> Result<(), String> {
    let points = || curves.iter().flat_map(|c| c.points.iter());
    let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let (x, y) = (most(&mut points().map(|p| p.0)), most(&mut points().map(|p| p.1)));
    if !(x > 0.0 && y > 0.0) {
        return Err("nothing to draw".to_owned());
    }
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE).map_err(|e| e.to_string())?;
    let mut chart = ChartBuilder::on(&root)
        .caption(labels.title, ("sans-serif", 20))
        .margin(16)
        .margin_right(40)
        .x_label_area_size(52)
        .y_label_area_size(76)
        .build_cartesian_2d(0.0..x, 0.0..1.15 * y)
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(labels.x)
        .y_desc(labels.y)
        .axis_desc_style(("sans-serif", 16))
        .label_style(("sans-serif", 14))
        .max_light_lines(1)
        .bold_line_style(RGBColor(220, 220, 220))
        .draw()
        .map_err(|e| e.to_string())?;
    for curve in curves {
        let line = curve.color.stroke_width(2);
        chart.draw_series(LineSeries::new(curve.points.iter().copied(), line)).map_err(|e| e.to_string())?;
    }
    root.present().map_err(|e| e.to_string())
}

/// 1, 2 and 5 times the powers of ten within a range.
pub(super) fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all = decades.flat_map(|e| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(e)));
    all.filter(|t| (low..=high).contains(t)).collect()
}

/// A range with a margin around the positive values; `None` when there are none.
pub(super) fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| *v > 0.0 && v.is_finite())
        .fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    (high > 0.0).then_some((low / 1.6, high * 1.6))
}

/// The shortest text of a number on an axis.
pub(super) fn short(value: &f64) -> String {
    if *value > 0.0 && *value < 1.5e-3 {
        return format!("{value:.0e}");
    }
    let rounded = format!("{value:.6}");
    let trimmed = rounded.trim_end_matches('0').trim_end_matches('.');
    if trimmed.is_empty() { "0".to_owned() } else { trimmed.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_names_its_axes_and_curves_and_one_of_nothing_is_refused() {
        let labels = Labels { title: "title", x: "across", y: "up" };
        let curve = Curve {
            name: "hybrid".to_owned(),
            color: BLACK,
            points: vec![(0.1, 3.0), (1.0, 30.0)],
            marks: vec!["finest".to_owned()],
        };
        let svg = draw(&labels, &[curve]).unwrap();
        for text in ["<svg", "title", "across", "up", "hybrid", "finest", "</svg>"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(matches!(draw(&labels, &[]), Err(BenchError::Chart { .. })));
        assert!(matches!(draw_linear(&labels, &[]), Err(BenchError::Chart { .. })));
        assert_eq!((short(&0.10), short(&20.0), short(&0.0)), ("0.1".to_owned(), "20".to_owned(), "0".to_owned()));
    }
}
