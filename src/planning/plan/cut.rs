//! Parting the bone's envelope into segments.

use std::collections::BTreeSet;

use super::assign::{Choice, Freed, assign};
use super::checked_cut::CheckedCut;
use super::lattice::{Crossing, OUTSIDE, lattice, strides};
use super::osteotomy::{Osteotomy, Segment};
use super::part_bridges::part_bridges;
use super::pieces::{Pieces, blocked_edges, crossings, flood};
use super::separation::{Saw, Separation};
use super::shape::{Cut, CutShape, Purpose};
use super::tuning::{FRAGMENT_MM3, MIN_THICKNESS_SHARE, SAWN_FRAGMENT_MM3};
use super::{Bridge, Miss, PlanError, bridge, solid};
use prosopon_field::Envelope;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, ScalarGrid, Warning};

/// Parts the bone envelope by the cuts.
///
/// The inside nodes of the envelope's grid are flooded over the grid edges that no cut crosses. Segment 0 is the largest
/// piece of the largest connected part of the bone, together with the parts that were separate before (a free mandible,
/// vertebrae) and that no cut divides or frees. The other pieces of divided parts, and the freed parts, get numbers from 1 by
/// falling volume. A cut that ends inside bone leaves no mark where the bone on both sides is still connected. The kerf is
/// removed from both segments where a cut separates them.
///
/// A piece is a fragment below 100 mm³, and up to 300 mm³ when the kerf leaves less than 100 mm³ of it. A fragment joins the
/// segment that it touches most, with a warning.
///
/// # Accuracy
/// Caps of plane cuts, and the sides of their kerf, are within 1 % of the grid spacing; on curved cuts the error is of second
/// order in the spacing. The caps of two neighbours have the same vertices. Corners between two cuts, and the rim between a cap
/// and the bone's surface, are accurate to about half the spacing.
///
/// # Errors
/// [`PlanError::Cut`] for a cut with a value that is not allowed and for a kerf that leaves less than 100 mm³ of a segment,
/// [`PlanError::MissesBone`], [`PlanError::NotParted`], [`PlanError::Cancelled`].
///
/// ```
/// use prosopon_field::Envelope;
/// use prosopon_geometry::control::Control;
/// use prosopon_geometry::{Aabb, Point, ScalarGrid, Vector, isosurface};
/// use prosopon_planning::plan::{BoundedPlane, Cut, cut};
///
/// // A block of 24 x 20 x 30 mm on a grid of 1 mm.
/// let block = Aabb { min: Point::new(-12.0, -10.0, 0.0), max: Point::new(12.0, 10.0, 30.0) };
/// let mut grid = ScalarGrid::covering(&block.grown(2.3), 1.0, 0.0);
/// let [nx, ny, _] = grid.dims;
/// for n in 0..grid.values.len() {
///     let p = grid.position(n % nx, n / nx % ny, n / (nx * ny));
///     grid.values[n] = (block.min - p).sup(&(p - block.max)).max() as f32;
/// }
/// let surface = isosurface(&grid, 0.0).ok_or("no surface")?;
/// let bone = Envelope { grid, surface, warnings: Vec::new(), regions: Vec::new() };
///
/// let plane = BoundedPlane { point: Point::new(0.0, 0.0, 12.2), normal: Vector::z(), bounds: None };
/// let osteotomy = cut(&bone, &[Cut::from(plane)], &Control::new())?;
/// assert_eq!(osteotomy.segments.len(), 2);
/// // The smaller piece, below the plane.
/// let lower = &osteotomy.segments[1];
/// assert!((lower.volume_mm3 / (24.0 * 20.0 * 12.2) - 1.0).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn cut(bone: &Envelope, cuts: &[Cut], control: &Control) -> Result<Osteotomy, PlanError> {
    if cuts.is_empty() {
        return Err(PlanError::Value { what: "cuts".into(), detail: "there are none; give at least one cut".into() });
    }
    let (parted, bridges) = PartedBone::new(bone, cuts, control)?;
    let freed = freed(&bone.grid, &parted.pieces, cuts);
    // How much a kerf leaves of a piece is known only once the segments are built; too small pieces then count as fragments.
    let mut small = BTreeSet::new();
    loop {
        let choice = parted.choice(&freed, &small, control)?;
        control.report(0.2);
        match parted.build(choice, bridges.as_ref(), control)? {
            Built::Done(osteotomy) => return Ok(osteotomy),
            Built::LeavesFragments(found) if found.is_subset(&small) => {
                let detail = "leave fragments below 100 mm³; use a smaller kerf or move the cuts apart".to_owned();
                return Err(PlanError::Value { what: "cuts".into(), detail });
            }
            Built::LeavesFragments(found) => small.extend(found),
        }
    }
}

/// Tries whether `cuts` part the bone, in a fraction of the time of [`cut`]. A kerf may still leave too little of a segment.
///
/// # Errors
/// As [`cut`].
pub fn try_cuts(bone: &Envelope, cuts: &[Cut], control: &Control) -> Result<(), PlanError> {
    let (parted, _) = PartedBone::new(bone, cuts, control)?;
    let freed = freed(&bone.grid, &parted.pieces, cuts);
    parted.choice(&freed, &BTreeSet::new(), control).map(|_| ())
}

/// Cuts of shape [`CutShape::FreePart`], each with the piece whose node is nearest to its point.
fn freed(grid: &ScalarGrid, pieces: &Pieces, cuts: &[Cut]) -> Vec<Freed> {
    let piece_at = |p: &Point| {
        let off = |node: usize| {
            let [i, j, k] = lattice(grid, node);
            (grid.position(i, j, k) - p).norm_squared()
        };
        let inside = (0..pieces.label.len()).filter(|n| pieces.label[*n] != OUTSIDE);
        let nearest = inside.map(|n| (off(n), n)).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(pieces.label[nearest.1] as usize)
    };
    let of_cut = |(cut, c): (usize, &Cut)| match &c.shape {
        CutShape::FreePart(p) => Some(Freed { cut, piece: piece_at(p)? }),
        CutShape::Plane(_) | CutShape::Polyline { .. } | CutShape::Surface(_) => None,
    };
    cuts.iter().enumerate().filter_map(of_cut).collect()
}

/// Refuses cuts that cross no bone.
fn check_hits(
    bone: &Envelope,
    cuts: &[Cut],
    checked_cuts: &[CheckedCut],
    crossings: &[Crossing],
) -> Result<(), PlanError> {
    let crosses = |cut: usize| crossings.iter().any(|c| c.cut == cut && c.in_bone);
    let missed = checked_cuts
        .iter()
        .enumerate()
        .filter(|(cut, checked_cut)| !matches!(checked_cut, CheckedCut::None) && !crosses(*cut));
    let missed_by: Vec<Miss> = missed
        .map(|(cut, checked_cut)| {
            let distances = checked_cut.distances(bone.surface.positions());
            Miss { cut, label: cuts[cut].label(cut), distance_mm: distances.into_iter().fold(f64::INFINITY, f64::min) }
        })
        .collect();
    if missed_by.is_empty() { Ok(()) } else { Err(PlanError::MissesBone { missed_by }) }
}

/// Result of building the segments of a [`Choice`].
enum Built {
    Done(Osteotomy),
    /// Pieces of which the kerf leaves less than [`FRAGMENT_MM3`].
    LeavesFragments(BTreeSet<usize>),
}

/// Bone with its cuts and the pieces between them.
struct PartedBone<'a> {
    bone: &'a Envelope,
    cuts: &'a [Cut],
    checked_cuts: Vec<CheckedCut>,
    crossings: Vec<Crossing>,
    blocked: Vec<u8>,
    pieces: Pieces,
}

impl<'a> PartedBone<'a> {
    /// Parts the bone by the cuts, and thin bridges that separations leave; returns a warning about these.
    fn new(bone: &'a Envelope, cuts: &'a [Cut], control: &Control) -> Result<(Self, Option<Warning>), PlanError> {
        let grid = &bone.grid;
        let checked_cuts =
            cuts.iter().enumerate().map(|(i, c)| CheckedCut::new(i, c)).collect::<Result<Vec<_>, _>>()?;
        let mut crossings = crossings(grid, &checked_cuts, control)?;
        check_hits(bone, cuts, &checked_cuts, &crossings)?;
        control.report(0.1);
        let mut blocked = blocked_edges(grid, &crossings);
        let mut pieces = flood(grid, &blocked, control)?;
        let mut warning = None;
        if let Some(bridges) = part_bridges(grid, &crossings, &blocked, &pieces, cuts, control)? {
            crossings.extend(bridges.crossings);
            crossings.sort_by_key(|c| (c.node, c.axis, c.cut));
            blocked = blocked_edges(grid, &crossings);
            pieces = flood(grid, &blocked, control)?;
            warning = Some(bridges.warning);
        }
        Ok((Self { bone, cuts, checked_cuts, crossings, blocked, pieces }, warning))
    }

    /// Which segment each piece belongs to; `small` are the pieces that count as fragments whatever their volume.
    fn choice(&self, freed: &[Freed], small: &BTreeSet<usize>, control: &Control) -> Result<Choice, PlanError> {
        let Self { bone, cuts, crossings, blocked, pieces, .. } = self;
        let Some(choice) = assign(&bone.grid, pieces, crossings, freed, small) else {
            return Err(bridge::not_parted(&bone.grid, crossings, blocked, cuts, control)?);
        };
        match freed.iter().find(|freed| choice.segment[freed.piece] == Some(0)) {
            Some(freed) => {
                let detail = "the bone at its point is connected to the skull; add a cut that separates it";
                Err(cuts[freed.cut].fault(freed.cut, "free_part", detail.to_owned()))
            }
            None => Ok(choice),
        }
    }

    /// Builds the segments of `choice`; `bridges` warns of bridges that were parted.
    fn build(&self, choice: Choice, bridges: Option<&Warning>, control: &Control) -> Result<Built, PlanError> {
        let Self { bone, cuts, checked_cuts, crossings, pieces, .. } = self;
        let grid = &bone.grid;
        let of_piece = |l: u32| if l == OUTSIDE { None } else { choice.segment[l as usize] };
        let of_node: Vec<u32> = pieces.label.iter().map(|l| of_piece(*l).unwrap_or(OUTSIDE)).collect();
        let saws: Vec<Saw<'_>> = (checked_cuts.iter().zip(*cuts))
            .map(|(checked_cut, cut)| Saw { checked_cut, kerf_mm: cut.kerf_mm })
            .collect();
        let separation = Separation::new(grid, &of_node, choice.n_segments, crossings, &saws);
        let idle = self.cuts_that_part_little(&of_node, control)?;
        let segments = solid::segments(grid, &of_node, &separation, &control.stage(0.2, 1.0))?;
        self.check_thickness(&segments)?;
        let fragments = self.sawn_away(&choice, &separation, &segments)?;
        if !fragments.is_empty() {
            return Ok(Built::LeavesFragments(fragments));
        }
        let warnings = choice.warning.into_iter().chain(bridges.cloned()).chain(idle).collect();
        let (bone_mm3, dropped_mm3) = (bone.surface.volume(), choice.dropped_mm3);
        Ok(Built::Done(Osteotomy { cuts: cuts.to_vec(), segments, bone_mm3, dropped_mm3, warnings, arch: None }))
    }

    /// Warnings about saw cuts that part little of the bone that they cross; `segment` holds the segment of each node.
    ///
    /// Cuts reach beyond the bone that they part; one that parts less than a quarter of what it crosses was meant to part more.
    /// Separations may find joints and teeth separate already.
    fn cuts_that_part_little(&self, segment: &[u32], control: &Control) -> Result<Vec<Warning>, PlanError> {
        let Self { bone, cuts, crossings, blocked, .. } = self;
        let steps = strides(&bone.grid);
        let mut warnings = Vec::new();
        for (cut, given) in cuts.iter().enumerate() {
            let own = || crossings.iter().filter(|c| c.cut == cut && c.in_bone);
            let apart = own().filter(|c| segment[c.node] != segment[c.node + steps[c.axis]]).count();
            if given.purpose == Purpose::Osteotomy && 4 * apart < own().count() {
                let bridges = bridge::of_cut(&bone.grid, crossings, blocked, cuts, cut, control)?;
                let places: Vec<String> = bridges.iter().take(5).map(Bridge::to_string).collect();
                let share = 100 * apart / own().count().max(1);
                let what = if apart == 0 { "nothing".to_owned() } else { format!("only {share} % of it") };
                let left = if places.is_empty() { "fragments".to_owned() } else { places.join("; ") };
                let message = format!("{} crosses bone but parts {what}; what remains: {left}", given.label(cut));
                warnings.push(Warning::check("cut-parts-little", message).act("Extend the cut where bone remains."));
            }
        }
        Ok(warnings)
    }

    /// Refuses segments that are a thin sheet, which two cuts in the same place leave between them.
    fn check_thickness(&self, segments: &[Segment]) -> Result<(), PlanError> {
        for segment in segments {
            let thickness_mm = 2.0 * segment.volume_mm3 / segment.area_mm2;
            if let [first, .., last] = *segment.bounded_by.as_slice()
                && thickness_mm < MIN_THICKNESS_SHARE * self.bone.grid.spacing
            {
                let detail = format!(
                    "leaves a sheet of bone {thickness_mm:.3} mm thick to {}; remove one if they lie on one another",
                    self.cuts[first].label(first)
                );
                return Err(self.cuts[last].fault(last, "", detail));
            }
        }
        Ok(())
    }

    /// Pieces of segments of which the kerf leaves less than [`FRAGMENT_MM3`].
    ///
    /// # Errors
    /// [`PlanError::Cut`] when such a segment had more than [`SAWN_FRAGMENT_MM3`] before it was sawn.
    fn sawn_away(
        &self,
        choice: &Choice,
        separation: &Separation,
        segments: &[Segment],
    ) -> Result<BTreeSet<usize>, PlanError> {
        let Self { bone, cuts, pieces, .. } = self;
        let mut fragments = BTreeSet::new();
        for (id, bounds) in separation.bounded_by.iter().enumerate() {
            let left = segments.iter().find(|s| s.id as usize == id).map_or(0.0, |s| s.volume_mm3);
            let widest = bounds.iter().max_by(|a, b| cuts[**a].kerf_mm.total_cmp(&cuts[**b].kerf_mm));
            if let Some(cut) = widest.filter(|c| cuts[**c].kerf_mm > 0.0 && left < FRAGMENT_MM3) {
                let own: Vec<usize> =
                    (0..pieces.size.len()).filter(|p| choice.segment[*p] == Some(id as u32)).collect();
                let whole: f64 = own.iter().map(|p| pieces.size[*p] as f64 * bone.grid.spacing.powi(3)).sum();
                if whole > SAWN_FRAGMENT_MM3 {
                    let detail = format!(
                        "a kerf of {} mm would leave {left:.0} mm³ of the {whole:.0} mm³ of bone of one segment; use a smaller \
                         kerf or move the cut",
                        cuts[*cut].kerf_mm
                    );
                    return Err(cuts[*cut].fault(*cut, "kerf_mm", detail));
                }
                fragments.extend(own);
            }
        }
        Ok(fragments)
    }
}
