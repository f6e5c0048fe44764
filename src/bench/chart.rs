//! Charts as SVG: one curve a builder, both axes logarithmic.

use plotters::coord::combinators::IntoLogRange;
use plotters::prelude::*;

use super::error::BenchError;
use super::row::Row;
use crate::field::Method;

const SIZE: (u32, u32) = (900, 600);

/// One curve.
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) color: RGBColor,
    /// Positive coordinates.
    pub(super) points: Vec<(f64, f64)>,
}

/// Title and axes.
pub(super) struct Labels<'a> {
    pub(super) title: &'a str,
    pub(super) x: &'a str,
    pub(super) y: &'a str,
}

/// Memory of the field against its largest error.
pub(super) fn memory(rows: &[Row]) -> Result<String, BenchError> {
    let labels = Labels {
        title: "Memory of a distance field against its largest measured error",
        x: "largest error in the band, mm",
        y: "memory of the field, MB",
    };
    draw(&labels, &by_method(rows, |r| r.timing.memory_mb))
}

/// Time to build the field against its largest error.
pub(super) fn time(rows: &[Row]) -> Result<String, BenchError> {
    let labels = Labels {
        title: "Time to build a distance field against its largest measured error",
        x: "largest error in the band, mm",
        y: "build, s",
    };
    draw(&labels, &by_method(rows, |r| r.timing.build_wall_s))
}

fn by_method(rows: &[Row], y: impl Fn(&Row) -> f64) -> Vec<Curve> {
    let curve = |method: Method| {
        let mut points: Vec<(f64, f64)> =
            rows.iter().filter(|r| r.case.method == method).map(|r| (r.accuracy.max_error_mm, y(r))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        Curve { name: method.name().to_owned(), color: color(method), points }
    };
    Method::ALL.into_iter().map(curve).collect()
}

/// Colours of Okabe and Ito, which colour-blind readers can tell apart.
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
        .caption(labels.title, ("sans-serif", 22))
        .margin(16)
        .x_label_area_size(52)
        .y_label_area_size(76)
        .build_cartesian_2d((x.0..x.1).log_scale(), (y.0..y.1).log_scale())
        .map_err(|e| e.to_string())?;
    chart
        .configure_mesh()
        .x_desc(labels.x)
        .y_desc(labels.y)
        .axis_desc_style(("sans-serif", 17))
        .label_style(("sans-serif", 14))
        .x_label_formatter(&short)
        .y_label_formatter(&short)
        .light_line_style(RGBColor(236, 236, 236))
        .bold_line_style(RGBColor(205, 205, 205))
        .draw()
        .map_err(|e| e.to_string())?;
    for curve in curves.iter().filter(|c| !c.points.is_empty()) {
        let color = curve.color;
        chart
            .draw_series(LineSeries::new(curve.points.iter().copied(), color.stroke_width(2)))
            .map_err(|e| e.to_string())?
            .label(curve.name.as_str())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], color.stroke_width(3)));
        chart
            .draw_series(curve.points.iter().map(|&p| Circle::new(p, 4, color.filled())))
            .map_err(|e| e.to_string())?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(170, 170, 170))
        .label_font(("sans-serif", 16))
        .legend_area_size(30)
        .margin(8)
        .draw()
        .map_err(|e| e.to_string())?;
    root.present().map_err(|e| e.to_string())
}

/// A range with room around positive values; `None` without any.
fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| *v > 0.0 && v.is_finite())
        .fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    (high > 0.0).then_some((low / 1.6, high * 1.6))
}

/// A number as short as it can be said.
fn short(value: &f64) -> String {
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
        let curve = Curve { name: "hybrid".to_owned(), color: BLACK, points: vec![(0.1, 3.0), (1.0, 30.0)] };
        let svg = draw(&labels, &[curve]).unwrap();
        for text in ["<svg", "title", "across", "up", "hybrid", "</svg>"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(matches!(draw(&labels, &[]), Err(BenchError::Chart { .. })));
        assert_eq!((short(&0.10), short(&20.0), short(&0.0)), ("0.1".to_owned(), "20".to_owned(), "0".to_owned()));
    }
}
