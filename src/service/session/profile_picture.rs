use plotters::coord::Shift;
use plotters::prelude::*;

use prosopon_contract::{ClinicalDocument, Fault, FaultKind, ProfilePieceDocument};

/// Scale of the picture, pixels for each mm.
const SCALE: f64 = 4.0;
/// Margin around the profile, mm, and width of the legend's column, pixels.
const MARGIN_MM: f64 = 8.0;
const LEGEND_PX: u32 = 190;
/// Largest size of the profile, mm; lines of a damaged document would make a picture of any size.
const MAX_MM: f64 = 400.0;
/// Colours of Okabe and Ito, which colour-blind readers can distinguish.
const BEFORE: RGBColor = RGBColor(120, 120, 120);
const AFTER: RGBColor = RGBColor(213, 94, 0);
const HARD: RGBColor = RGBColor(0, 114, 178);

/// Draws the profile before and after with the named points, the face towards the left, at equal scales, as SVG.
///
/// # Errors
/// [`FaultKind::NotFound`] when the document has no profile.
pub fn profile_picture(document: &ClinicalDocument) -> Result<String, Fault> {
    picture(document, true)
}

/// Draws the same picture without legend and angles, for pages that give them as text.
///
/// # Errors
/// [`FaultKind::NotFound`] when the document has no profile.
pub fn profile_drawing(document: &ClinicalDocument) -> Result<String, Fault> {
    picture(document, false)
}

fn picture(document: &ClinicalDocument, has_legend: bool) -> Result<String, Fault> {
    let mut svg = String::new();
    let frame = Frame::of(document)
        .ok_or_else(|| Fault::new(FaultKind::NotFound, "there is no profile: the midsagittal plane misses the skin"))?;
    drawn(&mut svg, document, &frame, has_legend).map_err(|detail| Fault::new(FaultKind::Internal, detail))?;
    Ok(svg)
}

/// The part of the sagittal plane that the picture shows, mm.
struct Frame {
    y: [f64; 2],
    z: [f64; 2],
}

impl Frame {
    fn of(document: &ClinicalDocument) -> Option<Self> {
        let lines = document.profile.iter().flat_map(|p| p.before_yz_mm.iter().chain(&p.after_yz_mm)).copied();
        let bones = document.hard_points.iter().map(|p| p.side_mm());
        let all: Vec<[f64; 2]> = lines.chain(bones).filter(|p| p.iter().all(|c| c.is_finite())).collect();
        let range = |axis: usize| {
            let ends = all.iter().map(|p| p[axis]);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            (low < high).then(|| [low - MARGIN_MM, high.min(low + MAX_MM) + MARGIN_MM])
        };
        Some(Self { y: range(0)?, z: range(1)? })
    }

    fn pixel(&self, [y, z]: [f64; 2]) -> (i32, i32) {
        (((y - self.y[0]) * SCALE).round() as i32, ((self.z[1] - z) * SCALE).round() as i32)
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn drawn(svg: &mut String, document: &ClinicalDocument, frame: &Frame, has_legend: bool) -> Result<(), String> {
    let said = |e: DrawingAreaErrorKind<_>| e.to_string();
    let width = ((frame.y[1] - frame.y[0]) * SCALE).ceil() as u32;
    let height = ((frame.z[1] - frame.z[0]) * SCALE).ceil() as u32;
    let column = if has_legend { LEGEND_PX } else { 0 };
    let root = SVGBackend::with_string(svg, (width + column, height)).into_drawing_area();
    root.fill(&WHITE).map_err(said)?;
    let line = |root: &Area<'_>, points: &dyn Fn(&ProfilePieceDocument) -> Vec<[f64; 2]>, style: ShapeStyle| {
        for piece in &document.profile {
            let path: Vec<(i32, i32)> = points(piece).into_iter().map(|p| frame.pixel(p)).collect();
            root.draw(&PathElement::new(path, style)).map_err(said)?;
        }
        Ok::<(), String>(())
    };
    line(&root, &|p| p.before_yz_mm.clone(), BEFORE.stroke_width(2))?;
    line(&root, &|p| p.after_yz_mm.clone(), AFTER.stroke_width(3))?;
    for (points, color) in [(&document.soft_points, AFTER), (&document.hard_points, HARD)] {
        for p in points {
            let [y, z] = p.side_mm();
            let (from, to) = (frame.pixel([y, z]), frame.pixel([y - p.forward_mm, z - p.down_mm]));
            root.draw(&PathElement::new([from, to], color.stroke_width(1))).map_err(said)?;
            root.draw(&Circle::new(from, 3, BEFORE.filled())).map_err(said)?;
            root.draw(&Circle::new(to, 3, color.filled())).map_err(said)?;
        }
    }
    if has_legend {
        legend(&root, document, width as i32)?;
    }
    root.present().map_err(said)
}

fn legend(root: &Area<'_>, document: &ClinicalDocument, left: i32) -> Result<(), String> {
    let said = |e: DrawingAreaErrorKind<_>| e.to_string();
    let mut y = 24;
    for (name, color) in [("before", BEFORE), ("after", AFTER), ("bone and teeth", HARD)] {
        root.draw(&PathElement::new([(left, y), (left + 22, y)], color.stroke_width(3))).map_err(said)?;
        root.draw(&Text::new(name, (left + 30, y - 8), ("sans-serif", 15))).map_err(said)?;
        y += 24;
    }
    for (name, unit, value) in [
        ("nasolabial", "°", document.nasolabial_deg),
        ("labiomental", "°", document.labiomental_deg),
        ("lip gap", " mm", document.lip_gap_mm),
    ] {
        if let Some(v) = value {
            let text = format!("{name} {:.1}{unit}, then {:.1}{unit}", v.before, v.after);
            root.draw(&Text::new(text, (left, y), ("sans-serif", 12))).map_err(said)?;
            y += 20;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_contract::{BeforeAfterDocument, NamedPointDocument};

    #[test]
    fn the_face_looks_left_at_equal_scales() {
        let point = NamedPointDocument {
            name: "pronasale".to_owned(),
            position_mm: [0.0, -110.0, 40.0],
            side_yz_mm: None,
            forward_mm: 2.0,
            down_mm: 0.0,
            left_mm: 0.0,
            proposed: true,
        };
        let mut document = ClinicalDocument {
            midline_x_mm: 0.0,
            midline_proposed: false,
            soft_points: vec![point],
            hard_points: Vec::new(),
            ratios: Vec::new(),
            profile: vec![ProfilePieceDocument {
                before_yz_mm: vec![[-100.0, 90.0], [-110.0, 40.0], [-90.0, -20.0]],
                after_yz_mm: vec![[-100.0, 90.0], [-112.0, 40.0], [-90.0, -20.0]],
            }],
            nasolabial_deg: Some(BeforeAfterDocument { before: 101.25, after: 98.0 }),
            labiomental_deg: None,
            lip_gap_mm: None,
            mouth_sealed: true,
        };
        let svg = profile_picture(&document).unwrap();
        for text in ["<svg", "before", "after", "nasolabial 101.2°, then 98.0°", "</svg>"] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("labiomental"));
        // The tip of the nose after the operation is the leftmost point, one margin from the left border and 50 mm below the
        // highest.
        let (x, y) = ((MARGIN_MM * SCALE) as i32, ((MARGIN_MM + 50.0) * SCALE) as i32);
        assert!(svg.contains(&format!("cx=\"{x}\" cy=\"{y}\"")), "{svg}");
        document.profile.clear();
        document.soft_points.clear();
        assert_eq!(profile_picture(&document).unwrap_err().kind, FaultKind::NotFound);
    }
}
