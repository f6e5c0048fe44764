//! Zones of bone to which tissue is not tied: teeth with gum, and bone that is stripped for the saw.

use rayon::prelude::*;

use crate::evaluate::MaskRegion;
use crate::plan::{DentalArch, Osteotomy, Segment, Teeth};
use crate::simulate::CutBone;
use crate::simulate::tuning::{BLEND_MM, ON_CUT_MM, STRIPPED_ABOVE_MM, STRIPPED_MM, TEETH_AND_GUM_MM};
use prosopon_geometry::{Implicit, Point};

/// A saw line between two segments of which at least one moves.
struct SawLine {
    /// Points of the line, LPS mm.
    points: Vec<Point>,
    /// Fixed segment below which an upper jaw moves; the zone on it is higher.
    above: Option<u32>,
}

/// Where tissue is not tied to bone.
pub(super) struct Zones<'a> {
    lines: Vec<SawLine>,
    arch: Option<&'a DentalArch>,
    /// Boxes of the caller in place of the arch.
    boxes: Option<&'a [MaskRegion]>,
    stripped_mm: f64,
}

/// A node in the zones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InZones {
    /// Share to which tissue is tied beside the teeth, 0 to 1.
    pub(super) at_teeth: f64,
    /// Share to which it is tied beside saw lines, 0 to 1.
    pub(super) stripped: f64,
    /// Distance to the nearest saw line, mm.
    pub(super) to_line_mm: f64,
}

impl<'a> Zones<'a> {
    /// Zones of cut bone of which the segments `moving` move. `boxes` replace the teeth; without `stripped_mm` the zones beside
    /// saw lines have their usual widths.
    pub(super) fn new(
        bone: &CutBone,
        moving: &[u32],
        arch: Option<&'a DentalArch>,
        boxes: Option<&'a [MaskRegion]>,
        stripped_mm: Option<f64>,
    ) -> Self {
        let osteotomy = &bone.osteotomy;
        let moves = |s: &Segment| moving.contains(&s.id);
        let mut lines = Vec::new();
        for (i, a) in osteotomy.segments.iter().enumerate() {
            for (b, field) in osteotomy.segments.iter().zip(&bone.fields).skip(i + 1) {
                if !(moves(a) || moves(b)) || !osteotomy.is_sawn_between(a, b) {
                    continue;
                }
                let points = saw_line(a, field.as_ref(), kerf_between(osteotomy, a, b));
                let is_upper = |s: &Segment| moves(s) && arch.and_then(|arch| arch.teeth_of(s)) == Some(Teeth::Upper);
                let above =
                    if !moves(a) && is_upper(b) { Some(a.id) } else { (!moves(b) && is_upper(a)).then_some(b.id) };
                lines.push(SawLine { points, above });
            }
        }
        Self { lines, arch, boxes, stripped_mm: stripped_mm.unwrap_or(STRIPPED_MM) }
    }

    /// Whether saw lines were found.
    pub(super) fn has_saw_lines(&self) -> bool {
        self.lines.iter().any(|line| !line.points.is_empty())
    }

    /// Distance from the zone of teeth and gum, mm; 0 inside, infinite when it is not known.
    fn to_teeth(&self, p: &Point) -> f64 {
        match (self.boxes, self.arch) {
            (Some(boxes), _) => {
                if boxes.iter().any(|b| b.contains(p)) {
                    0.0
                } else {
                    f64::INFINITY
                }
            }
            (None, Some(arch)) => arch.distance(p, TEETH_AND_GUM_MM),
            (None, None) => f64::INFINITY,
        }
    }

    /// Where the node at `p` on segment `own` lies.
    pub(super) fn of(&self, p: &Point, own: u32) -> InZones {
        let (mut stripped, mut to_line_mm) = (1.0f64, f64::INFINITY);
        for line in &self.lines {
            let squared = line.points.par_iter().with_min_len(256).map(|q| (q - p).norm_squared());
            let distance = squared.reduce(|| f64::INFINITY, f64::min).sqrt();
            to_line_mm = to_line_mm.min(distance);
            let is_above = line.above == Some(own) && self.arch.is_some_and(|arch| arch.height(p) > TEETH_AND_GUM_MM);
            let width = if is_above && self.stripped_mm > 0.0 {
                self.stripped_mm.max(STRIPPED_ABOVE_MM * self.stripped_mm / STRIPPED_MM)
            } else {
                self.stripped_mm
            };
            if width > 0.0 {
                stripped = stripped.min(tied_share(distance - width));
            }
        }
        InZones { at_teeth: tied_share(self.to_teeth(p) - 0.5 * BLEND_MM), stripped, to_line_mm }
    }
}

/// Share to which tissue is tied at a distance beyond the border of a zone (negative inside), mm.
fn tied_share(beyond_mm: f64) -> f64 {
    let t = (beyond_mm / BLEND_MM + 0.5).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Largest kerf of the cuts between two segments, mm.
fn kerf_between(osteotomy: &Osteotomy, a: &Segment, b: &Segment) -> f64 {
    let shared = a.bounded_by.iter().filter(|cut| b.bounded_by.contains(cut));
    shared.filter_map(|cut| osteotomy.cuts.get(*cut)).map(|c| c.kerf_mm).fold(0.0, f64::max)
}

/// Vertices of `segment` where its cut surface towards another segment, `other`, meets the surface of the bone.
fn saw_line(segment: &Segment, other: &dyn Implicit, kerf_mm: f64) -> Vec<Point> {
    let positions = segment.surface.positions();
    let on_cut: Vec<bool> = positions.par_iter().map(|p| other.value(p) < ON_CUT_MM + kerf_mm).collect();
    let mut rim = vec![false; positions.len()];
    for triangle in segment.surface.triangles() {
        let n = triangle.iter().filter(|v| on_cut[**v as usize]).count();
        if n == 1 || n == 2 {
            triangle.iter().filter(|v| on_cut[**v as usize]).for_each(|v| rim[*v as usize] = true);
        }
    }
    positions.iter().zip(rim).filter(|(_, rim)| *rim).map(|(p, _)| *p).collect()
}
