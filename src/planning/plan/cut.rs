//! Cutting the bone's envelope into segments.

use std::collections::{BTreeMap, BTreeSet};

use super::blade::Blade;
use super::complete::complete;
use super::parting::{Crossing, OUTSIDE, Pieces, Sets, blocked_edges, crossings, flood, lattice, strides};
use super::separation::{Saw, Separation};
use super::shape::{Cut, CutShape, Purpose};
use super::{Bridge, Miss, PlanError, bridge, solid};
use prosopon_field::Envelope;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, ScalarGrid, TriMesh};

/// Pieces below this volume are fragments, mm³: they join a neighbouring segment.
const CRUMB_MM3: f64 = 100.0;
/// A piece of up to this volume is a fragment too when the kerf leaves less than [`CRUMB_MM3`] of it, mm³; of a larger piece
/// that is an error.
const SAWN_CRUMB_MM3: f64 = 300.0;
/// Least thickness of a segment (volume over half its area) as a share of the grid spacing. A thinner one lies between two cuts
/// in the same place.
const THINNEST: f64 = 0.2;

/// A piece of bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// Number: 0 is the skull, which is fixed; the others follow by falling volume.
    pub id: u32,
    /// Suggested name, for example `maxilla`; [`super::name_segments`] sets it.
    pub name: Option<String>,
    /// Closed surface with caps, LPS mm, at rest.
    pub surface: TriMesh,
    /// Volume, mm³.
    pub volume_mm3: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Centroid of the solid, LPS mm, at rest.
    pub centroid: Point,
    /// Indices of the cuts that bound it, ascending.
    pub bounded_by: Vec<usize>,
}

impl Segment {
    /// Name of the segment in messages, for example `maxilla (segment 1)`.
    #[must_use]
    pub fn label(&self) -> String {
        self.name
            .as_ref()
            .map_or_else(|| format!("segment {}", self.id), |name| format!("{name} (segment {})", self.id))
    }
}

/// Bone cut into segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Osteotomy {
    /// The cuts.
    pub cuts: Vec<Cut>,
    /// The segments, ascending by number.
    pub segments: Vec<Segment>,
    /// Volume of the bone before it was cut, mm³.
    pub bone_mm3: f64,
    /// Volume of the fragments that touch no segment and were dropped, mm³.
    pub dropped_mm3: f64,
    /// What was dropped or should be checked.
    pub warnings: Vec<String>,
}

impl Osteotomy {
    /// Number of the segment that contains `p` (LPS mm), else of the one with the nearest vertex.
    ///
    /// `None` when there are no segments.
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
/// piece of the largest connected part of the bone, together with the parts that were separate before (a free mandible,
/// vertebrae) and that no cut divides or frees. The other pieces of divided parts, and the freed parts, get numbers from 1 by
/// falling volume. A cut that ends inside bone leaves no mark where the bone on both sides is still connected. Fragments, which
/// are pieces below 100 mm³ and pieces of up to 300 mm³ of which the kerf leaves less than that, join the segment that they touch
/// most, with a warning. The kerf is removed from both segments where a cut separates them.
///
/// # Accuracy
/// Caps of plane cuts, and the sides of their kerf, are within 1 % of the grid spacing; on curved cuts the error is of second
/// order in the spacing. The caps of two neighbours have the same vertices. Corners between two cuts, and the rim between a cap
/// and the bone's surface, are accurate to about half the spacing.
///
/// # Errors
/// [`PlanError::Value`] for a cut with a value that is not allowed and for a kerf that leaves less than 100 mm³ of a segment,
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
    let grid = &bone.grid;
    if cuts.is_empty() {
        return Err(PlanError::Value { what: "cuts".into(), detail: "there are none; give at least one cut".into() });
    }
    let blades = cuts.iter().enumerate().map(|(i, c)| Blade::new(i, c)).collect::<Result<Vec<_>, _>>()?;
    let mut crossings = crossings(grid, &blades, control)?;
    let missed = blades
        .iter()
        .enumerate()
        .filter(|(cut, blade)| !matches!(blade, Blade::None) && !crossings.iter().any(|c| c.cut == *cut && c.in_bone));
    let missed_by: Vec<Miss> = missed
        .map(|(cut, blade)| {
            let distances = blade.distances(bone.surface.positions());
            Miss { cut, label: cuts[cut].label(cut), distance_mm: distances.into_iter().fold(f64::INFINITY, f64::min) }
        })
        .collect();
    if !missed_by.is_empty() {
        return Err(PlanError::MissesBone { missed_by });
    }
    control.report(0.1);
    let mut blocked = blocked_edges(grid, &crossings);
    let mut pieces = flood(grid, &blocked, control)?;
    let completion = complete(grid, &crossings, &blocked, &pieces, cuts, control)?;
    let parted_too = completion.map(|c| {
        crossings.extend(c.crossings);
        crossings.sort_by_key(|c| (c.node, c.axis, c.cut));
        c.warning
    });
    if parted_too.is_some() {
        blocked = blocked_edges(grid, &crossings);
        pieces = flood(grid, &blocked, control)?;
    }
    let freed = freed(grid, &pieces, cuts);
    // How much a kerf leaves of a piece is known only once the segments are built; too small pieces then count as fragments.
    let mut small = BTreeSet::new();
    loop {
        let Some(mut choice) = assign(grid, &pieces, &crossings, (&freed, &small)) else {
            return Err(bridge::not_parted(grid, &crossings, &blocked, cuts, control)?);
        };
        if let Some((cut, _)) = freed.iter().find(|(_, piece)| choice.segment[*piece] == Some(0)) {
            let label = cuts[*cut].label(*cut);
            let detail =
                format!("the bone at the point of {label} is connected to the skull; add a cut that separates it");
            return Err(PlanError::Value { what: format!("cuts[{cut}].free_part"), detail });
        }
        control.report(0.2);
        choice.warnings.extend(parted_too.clone());
        let parted = Parted { bone, cuts, blades: &blades, crossings: &crossings, blocked: &blocked, pieces: &pieces };
        match parted.made(choice, control)? {
            Made::Done(osteotomy) => return Ok(osteotomy),
            Made::LeavesCrumbs(found) if found.is_subset(&small) => {
                let detail = "leave fragments below 100 mm³; use a smaller kerf or move the cuts apart".to_owned();
                return Err(PlanError::Value { what: "cuts".into(), detail });
            }
            Made::LeavesCrumbs(found) => small.extend(found),
        }
    }
}

/// Result of building the segments of a [`Choice`].
enum Made {
    Done(Osteotomy),
    /// Pieces of which the kerf leaves less than [`CRUMB_MM3`].
    LeavesCrumbs(BTreeSet<usize>),
}

/// Bone with its cuts and the pieces between them.
struct Parted<'a> {
    bone: &'a Envelope,
    cuts: &'a [Cut],
    blades: &'a [Blade],
    crossings: &'a [Crossing],
    blocked: &'a [u8],
    pieces: &'a Pieces,
}

impl Parted<'_> {
    /// Builds the segments of `choice`.
    fn made(&self, choice: Choice, control: &Control) -> Result<Made, PlanError> {
        let Self { bone, cuts, blades, crossings, blocked, pieces } = *self;
        let grid = &bone.grid;
        let of_piece = |l: u32| if l == OUTSIDE { None } else { choice.segment[l as usize] };
        let segments: Vec<u32> = pieces.label.iter().map(|l| of_piece(*l).unwrap_or(OUTSIDE)).collect();
        let saws: Vec<Saw<'_>> =
            blades.iter().zip(cuts).map(|(blade, cut)| Saw { blade, kerf_mm: cut.kerf_mm }).collect();
        let parting = Separation::new(grid, &segments, choice.n_segments, crossings, &saws);
        let mut warnings = choice.warnings;
        let steps = strides(grid);
        for cut in 0..cuts.len() {
            let own = || crossings.iter().filter(|c| c.cut == cut && c.in_bone);
            let apart = own().filter(|c| segments[c.node] != segments[c.node + steps[c.axis]]).count();
            // Cuts reach beyond the bone that they part; one that parts little of the bone that it crosses was meant to part
            // more. Separations may find joints and teeth separate already.
            if cuts[cut].purpose == Purpose::Osteotomy && 4 * apart < own().count() {
                let bridges = bridge::of_cut(grid, crossings, blocked, cuts, cut, control)?;
                let places: Vec<String> = bridges.iter().take(5).map(Bridge::to_string).collect();
                let share = 100 * apart / own().count().max(1);
                let what = if apart == 0 { "nothing".to_owned() } else { format!("only {share} % of it") };
                let left = if places.is_empty() { "fragments".to_owned() } else { places.join("; ") };
                warnings.push(format!(
                    "{} crosses bone but parts {what}; extend it where bone remains: {left}",
                    cuts[cut].label(cut)
                ));
            }
        }
        let part = control.stage(0.2, 1.0);
        let found = solid::segments(grid, &segments, &parting, &part)?;
        for segment in &found {
            let thickness_mm = 2.0 * segment.volume_mm3 / segment.area_mm2;
            if let [first, .., last] = *segment.bounded_by.as_slice()
                && thickness_mm < THINNEST * grid.spacing
            {
                let detail = format!(
                    "leaves a sheet of bone {thickness_mm:.3} mm thick to cut {first}; remove one if they lie on one another"
                );
                return Err(PlanError::Value { what: format!("cuts[{last}]"), detail });
            }
        }
        let mut crumbs = BTreeSet::new();
        for (id, bounds) in parting.bounded_by.iter().enumerate() {
            let left = found.iter().find(|s| s.id as usize == id).map_or(0.0, |s| s.volume_mm3);
            let widest = bounds.iter().max_by(|a, b| cuts[**a].kerf_mm.total_cmp(&cuts[**b].kerf_mm));
            if let Some(cut) = widest.filter(|c| cuts[**c].kerf_mm > 0.0 && left < CRUMB_MM3) {
                let own: Vec<usize> =
                    (0..pieces.size.len()).filter(|p| choice.segment[*p] == Some(id as u32)).collect();
                let whole: f64 = own.iter().map(|p| pieces.size[*p] as f64 * grid.spacing.powi(3)).sum();
                if whole > SAWN_CRUMB_MM3 {
                    let detail = format!(
                        "a kerf of {} mm would leave {left:.0} mm³ of segment {id}; use a smaller kerf or move the cut",
                        cuts[*cut].kerf_mm
                    );
                    return Err(PlanError::Value { what: format!("cuts[{cut}].kerf_mm"), detail });
                }
                crumbs.extend(own);
            }
        }
        if !crumbs.is_empty() {
            return Ok(Made::LeavesCrumbs(crumbs));
        }
        let (bone_mm3, dropped_mm3) = (bone.surface.volume(), choice.dropped_mm3);
        Ok(Made::Done(Osteotomy { cuts: cuts.to_vec(), segments: found, bone_mm3, dropped_mm3, warnings }))
    }
}

/// Cuts of shape [`CutShape::FreePart`], each with the piece whose node is nearest to its point.
fn freed(grid: &ScalarGrid, pieces: &Pieces, cuts: &[Cut]) -> Vec<(usize, usize)> {
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
        CutShape::FreePart(p) => Some((cut, piece_at(p)?)),
        CutShape::Plane(_) | CutShape::Polyline { .. } | CutShape::Surface(_) => None,
    };
    cuts.iter().enumerate().filter_map(of_cut).collect()
}

/// Which segment each piece belongs to.
struct Choice {
    /// Segment of each piece; `None` for dropped fragments.
    segment: Vec<Option<u32>>,
    n_segments: u32,
    dropped_mm3: f64,
    warnings: Vec<String>,
}

/// Assigns the pieces to segments; `None` when nothing larger than a fragment comes off.
///
/// `freed` holds cuts with the piece that each frees, `small` the pieces that count as fragments whatever their volume. A
/// fragment joins the neighbour with which it shares most crossed edges.
fn assign(
    grid: &ScalarGrid,
    pieces: &Pieces,
    crossings: &[Crossing],
    (freed, small): (&[(usize, usize)], &BTreeSet<usize>),
) -> Option<Choice> {
    let n = pieces.size.len();
    let voxel = grid.spacing.powi(3);
    let volume = |piece: usize| pieces.size[piece] as f64 * voxel;
    let is_crumb = |piece: usize| volume(piece) < CRUMB_MM3 || small.contains(&piece);
    let steps = strides(grid);
    let mut sets = Sets::new(n);
    for c in crossings.iter().filter(|c| c.in_bone) {
        sets.join(pieces.label[c.node], pieces.label[c.node + steps[c.axis]]);
    }
    let part: Vec<usize> = (0..n).map(|p| sets.find(p as u32) as usize).collect();
    let mut part_size = vec![0usize; n];
    let mut solids = vec![0usize; n];
    for p in 0..n {
        part_size[part[p]] += pieces.size[p];
        solids[part[p]] += usize::from(!is_crumb(p));
    }
    // The largest, and of equals the first.
    let largest = |sizes: &[usize], of: &mut dyn Iterator<Item = usize>| {
        of.fold(None, |best: Option<usize>, p| best.filter(|b| sizes[*b] >= sizes[p]).or(Some(p)))
    };
    let main = largest(&part_size, &mut (0..n))?;
    let stays = largest(&pieces.size, &mut (0..n).filter(|p| part[*p] == main))?;

    let divided = |p: usize| solids[part[p]] >= 2;
    let comes_off = |p: usize| divided(p) || freed.iter().any(|(_, piece)| *piece == p);
    let mut movable: Vec<usize> = (0..n).filter(|p| *p != stays && comes_off(*p) && !is_crumb(*p)).collect();
    if movable.is_empty() {
        return None;
    }
    movable.sort_by_key(|p| std::cmp::Reverse(pieces.size[*p]));
    let mut segment = vec![Some(0); n];
    for (i, p) in movable.iter().enumerate() {
        segment[*p] = Some(i as u32 + 1);
    }
    let mut crumbs: Vec<usize> = (0..n).filter(|p| divided(*p) && is_crumb(*p)).collect();
    crumbs.sort_by_key(|p| std::cmp::Reverse(pieces.size[*p]));
    crumbs.iter().for_each(|p| segment[*p] = None);
    let mut shared: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for c in crossings.iter().filter(|c| c.in_bone) {
        let [a, b] = [pieces.label[c.node], pieces.label[c.node + steps[c.axis]]].map(|l| l as usize);
        for pair in [(a, b), (b, a)].into_iter().filter(|_| a != b) {
            *shared.entry(pair).or_default() += 1;
        }
    }
    // A fragment that touches only fragments joins a segment in a later round.
    for _ in 0..crumbs.len() {
        for crumb in crumbs.iter().copied() {
            let beside = shared.range((crumb, 0)..(crumb + 1, 0)).filter(|((_, other), _)| segment[*other].is_some());
            let most = beside.max_by_key(|((_, other), faces)| (**faces, std::cmp::Reverse(*other)));
            if let (None, Some(((_, other), _))) = (segment[crumb], most) {
                segment[crumb] = segment[*other];
            }
        }
    }
    let lost = crumbs.iter().filter(|p| segment[**p].is_none());
    // The sum of no numbers is -0.0.
    let dropped_mm3 = lost.map(|p| volume(*p)).sum::<f64>() + 0.0;
    let mut warnings = Vec::new();
    if let Some(widest) = crumbs.first().copied() {
        let first = pieces.label.iter().position(|l| *l as usize == widest).unwrap_or(0);
        let [i, j, k] = lattice(grid, first);
        let at = grid.position(i, j, k);
        warnings.push(format!(
            "{} fragments ({:.0} mm³ together) were joined to the segments that they touch most; the largest has {:.0} mm³ near \
             ({:.0}, {:.0}, {:.0}) mm: check the cuts there",
            crumbs.len(),
            crumbs.iter().map(|p| volume(*p)).sum::<f64>(),
            volume(widest),
            at.x,
            at.y,
            at.z
        ));
    }
    Some(Choice { segment, n_segments: movable.len() as u32 + 1, dropped_mm3, warnings })
}
