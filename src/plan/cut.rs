//! Cutting the bone's envelope into segments.

use super::parting::{Crossing, OUTSIDE, Pieces, Sets, blocked_edges, crossings, flood, lattice, strides};
use super::separation::Separation;
use super::{PlanError, bridge, solid};
use crate::control::Control;
use crate::field::Envelope;
use crate::geometry::{Point, ScalarGrid, TriMesh, Vector};

/// Pieces smaller than this are crumbs of the saw: dropped and reported.
const CRUMB_MM3: f64 = 100.0;

/// A plane cut, bounded to a rectangle or endless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundedPlane {
    /// Centre of the rectangle, LPS mm.
    pub point: Point,
    /// Unit normal.
    pub normal: Vector,
    /// Unit direction in the plane and half extents along it and across it (`normal × direction`), mm; `None` is endless.
    pub bounds: Option<(Vector, f64, f64)>,
}

/// A piece of bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Number: 0 is the skull that stays; others by falling volume.
    pub id: u32,
    /// Closed surface with caps, LPS mm, at rest.
    pub surface: TriMesh,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Centroid of the solid.
    pub centroid: Point,
    /// Indices of the cuts that bound it.
    pub bounded_by: Vec<usize>,
}

/// Bone in pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct Osteotomy {
    /// The cuts.
    pub cuts: Vec<BoundedPlane>,
    /// The pieces, by id.
    pub segments: Vec<Segment>,
    /// What was dropped or is doubtful.
    pub warnings: Vec<String>,
}

/// A checked cut with an orthonormal frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blade {
    point: Point,
    normal: Vector,
    /// Directions in the plane and half extents along them.
    sides: Option<[(Vector, f64); 2]>,
}

impl Blade {
    pub(super) fn new(index: usize, cut: &BoundedPlane) -> Result<Self, PlanError> {
        let fault = |name: &str, detail: &str| {
            Err(PlanError::Value { what: format!("cuts[{index}].{name}"), detail: detail.into() })
        };
        if !cut.point.iter().all(|c| c.is_finite()) {
            return fault("point", "is not finite");
        }
        let unit = |v: &Vector| v.try_normalize(1e-9).filter(|u| u.iter().all(|c| c.is_finite()));
        let Some(normal) = unit(&cut.normal) else { return fault("normal", "has no direction") };
        let Some((direction, along, across)) = cut.bounds else {
            return Ok(Self { point: cut.point, normal, sides: None });
        };
        let Some(u) = unit(&direction).and_then(|d| unit(&(d - normal * normal.dot(&d)))) else {
            return fault("bounds", "the direction is not in the plane");
        };
        if !(along > 0.0 && across > 0.0) {
            return fault("bounds", "half extents must be above 0 mm");
        }
        Ok(Self { point: cut.point, normal, sides: Some([(u, along), (normal.cross(&u), across)]) })
    }

    /// Signed distance from the endless plane, mm.
    pub(super) fn side(&self, p: &Point) -> f64 {
        self.normal.dot(&(p - self.point))
    }

    /// Whether the grid edge `from`–`to` meets the cut (`endless`: its whole plane). A node in the plane counts to the side
    /// of the normal; both ends are judged by the same arithmetic at every edge, so that no gap opens by rounding.
    pub(super) fn crosses(&self, from: &Point, to: &Point, endless: bool) -> bool {
        let (a, b) = (self.side(from), self.side(to));
        if (a < 0.0) == (b < 0.0) {
            return false;
        }
        let Some(sides) = self.sides.filter(|_| !endless) else { return true };
        let hit = (from - self.point) + (to - from) * (a / (a - b));
        sides.iter().all(|(u, half)| u.dot(&hit).abs() <= *half)
    }

    /// Distance from `p` to the cut, mm.
    fn distance(&self, p: &Point) -> f64 {
        let d = p - self.point;
        let beyond = self.sides.map_or([0.0; 2], |s| s.map(|(u, half)| (u.dot(&d).abs() - half).max(0.0)));
        Vector::new(self.side(p), beyond[0], beyond[1]).norm()
    }
}

impl Osteotomy {
    /// The segment whose solid contains `p` or, where none does, whose surface has the vertex nearest to `p`.
    #[must_use]
    pub fn segment_near(&self, p: &Point) -> Option<u32> {
        let nearest =
            |s: &Segment| s.surface.positions().iter().map(|q| (q - p).norm_squared()).fold(f64::MAX, f64::min);
        let inside = self.segments.iter().find(|s| solid::contains(&s.surface, p));
        let best = || self.segments.iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        inside.or_else(best).map(|s| s.id)
    }
}

/// Parts the bone envelope by the cuts.
///
/// The inside nodes of the envelope's grid are flooded over the grid edges that no cut crosses. Segment 0 is the largest
/// piece of the largest part of the bone, together with the parts that were apart before (a free mandible, vertebrae) and
/// that no cut divides. All pieces of a divided part other than segment 0's get numbers from 1 by falling volume. A cut
/// that ends inside bone leaves no mark where the bone on both sides still hangs together. Pieces below 100 mm³ are dropped
/// with a warning.
///
/// # Accuracy
/// Caps lie in the cuts, up to 1 % of the grid spacing, and the caps of two neighbours have the same vertices. Corners
/// between two cuts, and the rim between a cap and the bone's surface, are right to about half the spacing.
///
/// # Errors
/// [`PlanError::Value`] for faulty cuts, [`PlanError::MissesBone`], [`PlanError::NotParted`], cancellation.
pub fn cut(bone: &Envelope, cuts: &[BoundedPlane], control: &Control) -> Result<Osteotomy, PlanError> {
    let grid = &bone.grid;
    if cuts.is_empty() {
        return Err(PlanError::Value { what: "cuts".into(), detail: "are missing; at least one is needed".into() });
    }
    let blades = cuts.iter().enumerate().map(|(i, c)| Blade::new(i, c)).collect::<Result<Vec<_>, _>>()?;
    let crossings = crossings(grid, &blades, false, control)?;
    for (cut, blade) in blades.iter().enumerate() {
        if !crossings.iter().any(|c| c.cut == cut) {
            let distances = bone.surface.positions().iter().map(|p| blade.distance(p));
            return Err(PlanError::MissesBone { cut, distance_mm: distances.fold(f64::INFINITY, f64::min) });
        }
    }
    control.report(0.1);
    let blocked = blocked_edges(grid, &crossings);
    let pieces = flood(grid, &blocked, control)?;
    control.report(0.2);

    let Some(choice) = assign(grid, &pieces, &crossings) else {
        return Err(bridge::locate(grid, &blades, &crossings, &blocked, control)?);
    };
    let of_piece = |l: u32| if l == OUTSIDE { None } else { choice.segment[l as usize] };
    let segments: Vec<u32> = pieces.label.iter().map(|l| of_piece(*l).unwrap_or(OUTSIDE)).collect();
    let parting = Separation::new(grid, &segments, choice.n_segments, &crossings, &blades);
    let mut warnings = choice.warnings;
    for cut in 0..cuts.len() {
        if !parting.bounded_by.iter().any(|b| b.contains(&cut)) {
            warnings.push(format!("cut {cut} runs in bone but parts nothing"));
        }
    }
    let part = control.part(0.2, 1.0);
    let segments = solid::segments(grid, &segments, &parting, &part)?;
    Ok(Osteotomy { cuts: cuts.to_vec(), segments, warnings })
}

/// Which segment each piece belongs to.
struct Choice {
    /// By piece; `None` for dropped crumbs.
    segment: Vec<Option<u32>>,
    n_segments: u32,
    warnings: Vec<String>,
}

/// `None` when no part of the bone falls into two pieces that are more than crumbs.
fn assign(grid: &ScalarGrid, pieces: &Pieces, crossings: &[Crossing]) -> Option<Choice> {
    let n = pieces.size.len();
    let voxel = grid.spacing.powi(3);
    let volume = |piece: usize| pieces.size[piece] as f64 * voxel;
    let steps = strides(grid);
    let mut sets = Sets::new(n);
    for c in crossings {
        sets.join(pieces.label[c.node], pieces.label[c.node + steps[c.axis]]);
    }
    let part: Vec<usize> = (0..n).map(|p| sets.find(p as u32) as usize).collect();
    let mut part_size = vec![0usize; n];
    let mut solids = vec![0usize; n];
    for p in 0..n {
        part_size[part[p]] += pieces.size[p];
        solids[part[p]] += usize::from(volume(p) >= CRUMB_MM3);
    }
    // The largest, and of equals the first.
    let largest = |sizes: &[usize], of: &mut dyn Iterator<Item = usize>| {
        of.fold(None, |best: Option<usize>, p| best.filter(|b| sizes[*b] >= sizes[p]).or(Some(p)))
    };
    let main = largest(&part_size, &mut (0..n))?;
    let stays = largest(&pieces.size, &mut (0..n).filter(|p| part[*p] == main))?;

    let divided = |p: usize| solids[part[p]] >= 2;
    let mut movable: Vec<usize> = (0..n).filter(|p| *p != stays && divided(*p) && volume(*p) >= CRUMB_MM3).collect();
    if movable.is_empty() {
        return None;
    }
    movable.sort_by_key(|p| std::cmp::Reverse(pieces.size[*p]));
    let mut segment = vec![Some(0); n];
    for (i, p) in movable.iter().enumerate() {
        segment[*p] = Some(i as u32 + 1);
    }
    let crumbs: Vec<usize> = (0..n).filter(|p| divided(*p) && volume(*p) < CRUMB_MM3).collect();
    for p in &crumbs {
        segment[*p] = None;
    }
    let mut warnings = Vec::new();
    if let Some(widest) = largest(&pieces.size, &mut crumbs.iter().copied()) {
        let first = pieces.label.iter().position(|l| *l as usize == widest).unwrap_or(0);
        let [i, j, k] = lattice(grid, first);
        let at = grid.position(i, j, k);
        warnings.push(format!(
            "{} crumbs of {:.0} mm³ together were dropped at the cuts, the largest of {:.0} mm³ near ({:.0}, {:.0}, {:.0}) mm",
            crumbs.len(),
            crumbs.iter().map(|p| volume(*p)).sum::<f64>(),
            volume(widest),
            at.x,
            at.y,
            at.z
        ));
    }
    Some(Choice { segment, n_segments: movable.len() as u32 + 1, warnings })
}
