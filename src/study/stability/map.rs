//! The picture of the verdicts by scene and method.

use plotters::prelude::*;

use super::cell::{Cell, Verdict};
use super::method::METHODS;
use crate::error::BenchError;

const SCENES_WIDE: i32 = 400;
const CELL_WIDE: i32 = 216;
const ROW_HIGH: i32 = 30;
const HEAD_HIGH: i32 = 76;
const FOOT_HIGH: i32 = 74;

/// Colours that colour-blind readers can distinguish; only wrong results are red.
fn color(verdict: Verdict) -> RGBColor {
    match verdict {
        Verdict::Converged => RGBColor(190, 225, 205),
        Verdict::Helped => RGBColor(240, 228, 150),
        Verdict::Warned => RGBColor(180, 205, 235),
        Verdict::Refused => RGBColor(215, 215, 215),
        Verdict::Wrong => RGBColor(225, 60, 50),
    }
}

const MEANINGS: [(Verdict, &str); 5] = [
    (Verdict::Converged, "converged: difference from the check on the skin"),
    (Verdict::Helped, "converged with help: which help"),
    (Verdict::Warned, "result with a warning: difference from finite strain or a finer mesh"),
    (Verdict::Refused, "refused with a named error: position on the path, stretch"),
    (Verdict::Wrong, "wrong without a warning"),
];

/// Draws the map, with scenes as rows and methods as columns.
pub(super) fn draw(rows: &[(String, Vec<Cell>)]) -> Result<String, BenchError> {
    let mut svg = String::new();
    drawn(&mut svg, rows).map_err(|detail| BenchError::Chart { detail })?;
    Ok(svg)
}

fn drawn(svg: &mut String, rows: &[(String, Vec<Cell>)]) -> Result<(), String> {
    let wide = SCENES_WIDE + CELL_WIDE * METHODS.len() as i32 + 20;
    let high = HEAD_HIGH + ROW_HIGH * rows.len() as i32 + FOOT_HIGH;
    let root = SVGBackend::with_string(svg, (wide as u32, high as u32)).into_drawing_area();
    let fault = |e: &dyn std::fmt::Display| e.to_string();
    root.fill(&WHITE).map_err(|e| fault(&e))?;
    let write = |text: &str, at: (i32, i32), size: i32| {
        root.draw(&Text::new(text.to_owned(), at, ("sans-serif", size))).map_err(|e| fault(&e))
    };
    let fill = |from: (i32, i32), to: (i32, i32), verdict| {
        root.draw(&Rectangle::new([from, to], color(verdict).filled())).map_err(|e| fault(&e))
    };
    write("Verdicts on every method in hard scenes", (10, 12), 20)?;
    for (n, method) in METHODS.iter().enumerate() {
        write(method.name, (SCENES_WIDE + CELL_WIDE * n as i32 + 8, HEAD_HIGH - 24), 15)?;
    }
    for (r, (name, cells)) in rows.iter().enumerate() {
        let top = HEAD_HIGH + ROW_HIGH * r as i32;
        write(name, (10, top + 8), 14)?;
        for (n, cell) in cells.iter().enumerate() {
            let left = SCENES_WIDE + CELL_WIDE * n as i32;
            fill((left, top), (left + CELL_WIDE - 3, top + ROW_HIGH - 3), cell.verdict)?;
            write(&cell.short, (left + 6, top + 8), 12)?;
        }
    }
    let foot = HEAD_HIGH + ROW_HIGH * rows.len() as i32 + 12;
    for (n, (verdict, meaning)) in MEANINGS.into_iter().enumerate() {
        let (left, top) = (10 + 480 * (n as i32 % 3), foot + 26 * (n as i32 / 3));
        fill((left, top), (left + 18, top + 18), verdict)?;
        write(meaning, (left + 24, top + 3), 12)?;
    }
    root.present().map_err(|e| fault(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_names_scenes_methods_and_answers() {
        let cell = |verdict: Verdict| Cell {
            verdict,
            short: format!("it {}", verdict.name()),
            detail: String::new(),
            error_mm: None,
            model_error_mm: None,
        };
        let cells = MEANINGS.iter().map(|m| cell(m.0)).collect();
        let svg = draw(&[("a scene".to_owned(), cells)]).unwrap();
        for text in ["a scene", "mass_tensor", "it refused", "it wrong", "E13C32"] {
            assert!(svg.contains(text), "{text}");
        }
    }
}
