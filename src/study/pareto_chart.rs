//! Time against error on several scenes side by side, with the Pareto front, the choices of `auto` and lines for other programs.

use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::prelude::*;

use super::chart::{Curve, Labels, short, span, ticks};
use super::error::BenchError;

const WIDTH: u32 = 560;
const HEIGHT: u32 = 620;
/// Width of the legend on the right, pixels.
const LEGEND: u32 = 230;
const FRONT: RGBColor = RGBColor(150, 150, 150);
const STAR: RGBColor = RGBColor(200, 0, 0);

/// The plot of one scene.
pub(super) struct Panel {
    pub(super) title: String,
    /// A curve for each model and formulation: error, mm, and time, s, of each mesh.
    pub(super) curves: Vec<Curve>,
    /// Choices of `auto` with their labels.
    pub(super) stars: Vec<((f64, f64), String)>,
    /// Names and times, s, of other programs.
    pub(super) lines: Vec<(String, f64)>,
}

impl Panel {
    /// Points that no other point beats in both time and error, from fast to accurate.
    fn front(&self) -> Vec<(f64, f64)> {
        let all: Vec<(f64, f64)> = self.curves.iter().flat_map(|c| c.points.iter().copied()).collect();
        let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
        let mut front: Vec<_> = all.iter().filter(|p| !all.iter().any(|q| beats(q, p))).copied().collect();
        front.sort_by(|a, b| b.0.total_cmp(&a.0));
        front
    }
}

/// Draws the panels over common logarithmic axes.
pub(super) fn draw(labels: &Labels, panels: &[Panel]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, labels, panels).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn(svg: &mut String, labels: &Labels, panels: &[Panel]) -> Result<(), String> {
    let points = || panels.iter().flat_map(|p| p.curves.iter()).flat_map(|c| c.points.iter());
    let x = span(points().map(|p| p.0)).ok_or("nothing to draw")?;
    let y = span(points().map(|p| p.1).chain(panels.iter().flat_map(|p| &p.lines).map(|l| l.1)))
        .ok_or("nothing to draw")?;
    let size = (WIDTH * panels.len() as u32 + LEGEND, HEIGHT);
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    root.fill(&WHITE).map_err(|e| e.to_string())?;
    let title = Text::new(labels.title.to_owned(), (16, 12), ("sans-serif", 20));
    root.draw(&title).map_err(|e| e.to_string())?;
    let (plots, legend) = root.margin(40, 0, 0, 0).split_horizontally(size.0 - LEGEND);
    for (panel, area) in panels.iter().zip(plots.split_evenly((1, panels.len()))) {
        let mut chart = ChartBuilder::on(&area)
            .caption(&panel.title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(48)
            .y_label_area_size(66)
            .build_cartesian_2d(
                (x.0..x.1).log_scale().with_key_points(ticks(x)),
                (y.0..y.1).log_scale().with_key_points(ticks(y)),
            )
            .map_err(|e| e.to_string())?;
        chart
            .configure_mesh()
            .x_desc(labels.x)
            .y_desc(labels.y)
            .axis_desc_style(("sans-serif", 15))
            .label_style(("sans-serif", 14))
            .x_label_formatter(&short)
            .y_label_formatter(&short)
            .max_light_lines(1)
            .bold_line_style(RGBColor(225, 225, 225))
            .draw()
            .map_err(|e| e.to_string())?;
        let front = LineSeries::new(panel.front(), FRONT.stroke_width(9));
        chart.draw_series(front).map_err(|e| e.to_string())?;
        for (name, seconds) in &panel.lines {
            let line = DashedLineSeries::new([(x.0, *seconds), (x.1, *seconds)], 6, 5, BLACK.stroke_width(1));
            chart.draw_series(line).map_err(|e| e.to_string())?;
            let word = EmptyElement::at((x.0, *seconds)) + Text::new(name.clone(), (6, -16), ("sans-serif", 13));
            chart.draw_series([word]).map_err(|e| e.to_string())?;
        }
        for curve in &panel.curves {
            let line = LineSeries::new(curve.points.iter().copied(), curve.color.stroke_width(2));
            chart.draw_series(line).map_err(|e| e.to_string())?;
            let dots = curve.points.iter().map(|&p| Circle::new(p, 4, curve.color.filled()));
            chart.draw_series(dots).map_err(|e| e.to_string())?;
            let marks = curve.points.iter().zip(&curve.marks).map(|(&point, mark)| {
                let style = ("sans-serif", 12).into_font().color(&curve.color);
                EmptyElement::at(point) + Text::new(mark.clone(), (7, 2), style)
            });
            chart.draw_series(marks).map_err(|e| e.to_string())?;
        }
        let stars = panel.stars.iter().map(|(point, mark)| {
            let style = ("sans-serif", 14).into_font().color(&STAR);
            // A light ground keeps the word readable over curves and their marks.
            let ground = Rectangle::new([(-20, 12), (7 * mark.len() as i32 - 12, 30)], WHITE.mix(0.85).filled());
            let word = Text::new(mark.clone(), (-16, 14), style);
            EmptyElement::at(*point) + ground + Polygon::new(star(), STAR.filled()) + word
        });
        chart.draw_series(stars).map_err(|e| e.to_string())?;
    }
    let names = panels.first().map(|p| p.curves.iter().map(|c| (c.name.as_str(), c.color, 2))).into_iter().flatten();
    for (n, (name, color, width)) in names.chain([("Pareto front", FRONT, 9)]).enumerate() {
        let middle = 56 + 25 * n as i32;
        let line = PathElement::new([(8, middle), (32, middle)], color.stroke_width(width));
        legend.draw(&line).map_err(|e| e.to_string())?;
        let name = Text::new(name.to_owned(), (40, middle - 8), ("sans-serif", 15));
        legend.draw(&name).map_err(|e| e.to_string())?;
    }
    let last = 56 + 25 * (panels.first().map_or(0, |p| p.curves.len()) as i32 + 1);
    let sign = EmptyElement::at((20, last)) + Polygon::new(star(), STAR.filled());
    legend.draw(&sign).map_err(|e| e.to_string())?;
    let name = Text::new("auto, by the error asked", (40, last - 8), ("sans-serif", 15));
    legend.draw(&name).map_err(|e| e.to_string())?;
    root.present().map_err(|e| e.to_string())
}

/// Corners of a star around the origin, pixels.
fn star() -> Vec<(i32, i32)> {
    let corner = |k: u32| {
        let (radius, angle) = (if k.is_multiple_of(2) { 10.0 } else { 4.0 }, f64::from(k) * std::f64::consts::PI / 5.0);
        ((radius * angle.sin()).round() as i32, (-radius * angle.cos()).round() as i32)
    };
    (0..10).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_has_its_panels_front_stars_and_lines() {
        let curve = |name: &str, points: Vec<(f64, f64)>| {
            let marks = points.iter().map(|p| format!("{} mm", p.1)).collect();
            Curve { name: name.to_owned(), color: BLUE, points, marks }
        };
        let curves =
            vec![curve("plain", vec![(0.5, 2.0), (0.3, 9.0)]), curve("patched", vec![(0.4, 5.0), (0.35, 12.0)])];
        let panel = Panel {
            title: "phantom".to_owned(),
            curves,
            stars: vec![((0.4, 5.0), "0.3".to_owned())],
            lines: vec![("paper".to_owned(), 1230.0)],
        };
        assert_eq!(panel.front(), [(0.5, 2.0), (0.4, 5.0), (0.3, 9.0)]);
        let labels = Labels { title: "title", x: "across", y: "up" };
        let svg = draw(&labels, &[panel]).unwrap();
        for text in ["title", "phantom", "across", "up", "plain", "patched", "paper", "0.3", "polygon", "Pareto front"]
        {
            assert!(svg.contains(text), "{text}");
        }
        assert!(matches!(draw(&labels, &[]), Err(BenchError::Chart { .. })));
    }
}
