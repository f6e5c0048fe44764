//! Which segment each piece of bone belongs to.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use super::lattice::{Crossing, lattice, strides};
use super::pieces::{Pieces, Sets};
use super::tuning::FRAGMENT_MM3;
use prosopon_geometry::{ScalarGrid, Warning};

/// A cut of shape [`CutShape::FreePart`](super::CutShape::FreePart) with the piece that it frees.
#[derive(Debug, Clone, Copy)]
pub(super) struct Freed {
    pub(super) cut: usize,
    pub(super) piece: usize,
}

/// Which segment each piece belongs to.
pub(super) struct Choice {
    /// Segment of each piece; `None` for dropped fragments.
    pub(super) segment: Vec<Option<u32>>,
    pub(super) n_segments: u32,
    pub(super) dropped_mm3: f64,
    /// About fragments that joined a segment.
    pub(super) warning: Option<Warning>,
}

/// Assigns the pieces to segments; `None` when nothing larger than a fragment comes off.
///
/// `small` are the pieces that count as fragments whatever their volume. A fragment joins the neighbour with which it shares
/// most crossed edges.
pub(super) fn assign(
    grid: &ScalarGrid,
    pieces: &Pieces,
    crossings: &[Crossing],
    freed: &[Freed],
    small: &BTreeSet<usize>,
) -> Option<Choice> {
    let n = pieces.size.len();
    let voxel = grid.spacing.powi(3);
    let volume = |piece: usize| pieces.size[piece] as f64 * voxel;
    let is_fragment = |piece: usize| volume(piece) < FRAGMENT_MM3 || small.contains(&piece);
    let part = parts(grid, pieces, crossings);
    let mut part_size = vec![0usize; n];
    let mut solids = vec![0usize; n];
    for p in 0..n {
        part_size[part[p]] += pieces.size[p];
        solids[part[p]] += usize::from(!is_fragment(p));
    }
    let main = largest(&part_size, 0..n)?;
    let fixed = largest(&pieces.size, (0..n).filter(|p| part[*p] == main))?;

    let divided = |p: usize| solids[part[p]] >= 2;
    let comes_off = |p: usize| divided(p) || freed.iter().any(|freed| freed.piece == p);
    let mut movable: Vec<usize> = (0..n).filter(|p| *p != fixed && comes_off(*p) && !is_fragment(*p)).collect();
    if movable.is_empty() {
        return None;
    }
    movable.sort_by_key(|p| Reverse(pieces.size[*p]));
    let mut segment = vec![Some(0); n];
    for (i, p) in movable.iter().enumerate() {
        segment[*p] = Some(i as u32 + 1);
    }
    let mut fragments: Vec<usize> = (0..n).filter(|p| divided(*p) && is_fragment(*p)).collect();
    fragments.sort_by_key(|p| Reverse(pieces.size[*p]));
    join(&fragments, &shared_edges(grid, pieces, crossings), &mut segment);
    let lost = fragments.iter().filter(|p| segment[**p].is_none());
    // The sum of no numbers is -0.0.
    let dropped_mm3 = lost.map(|p| volume(*p)).sum::<f64>() + 0.0;
    let warning = fragments_kept(grid, pieces, &fragments, volume);
    Some(Choice { segment, n_segments: movable.len() as u32 + 1, dropped_mm3, warning })
}

/// Of each piece the smallest piece to which it was connected before the cuts.
fn parts(grid: &ScalarGrid, pieces: &Pieces, crossings: &[Crossing]) -> Vec<usize> {
    let steps = strides(grid);
    let n = pieces.size.len();
    let mut sets = Sets::new(n);
    for c in crossings.iter().filter(|c| c.in_bone) {
        sets.join(pieces.label[c.node], pieces.label[c.node + steps[c.axis]]);
    }
    (0..n).map(|p| sets.find(p as u32) as usize).collect()
}

/// The index with the largest size, and of equals the first.
fn largest(sizes: &[usize], mut of: impl Iterator<Item = usize>) -> Option<usize> {
    let first = of.next()?;
    Some(of.fold(first, |best, p| if sizes[best] >= sizes[p] { best } else { p }))
}

/// Number of crossed edges between two pieces, in both orders.
fn shared_edges(grid: &ScalarGrid, pieces: &Pieces, crossings: &[Crossing]) -> BTreeMap<(usize, usize), usize> {
    let steps = strides(grid);
    let mut shared: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for c in crossings.iter().filter(|c| c.in_bone) {
        let [a, b] = [pieces.label[c.node], pieces.label[c.node + steps[c.axis]]].map(|l| l as usize);
        for pair in [(a, b), (b, a)].into_iter().filter(|_| a != b) {
            *shared.entry(pair).or_default() += 1;
        }
    }
    shared
}

/// Gives each fragment, by falling size, the segment with which it shares most edges; `None` where it touches none.
fn join(fragments: &[usize], shared: &BTreeMap<(usize, usize), usize>, segment: &mut [Option<u32>]) {
    fragments.iter().for_each(|p| segment[*p] = None);
    // A fragment that touches only fragments joins a segment in a later round.
    for _ in 0..fragments.len() {
        for fragment in fragments.iter().copied() {
            let beside =
                shared.range((fragment, 0)..(fragment + 1, 0)).filter(|((_, other), _)| segment[*other].is_some());
            let most = beside.max_by_key(|((_, other), faces)| (**faces, Reverse(*other)));
            if let (None, Some(((_, other), _))) = (segment[fragment], most) {
                segment[fragment] = segment[*other];
            }
        }
    }
}

/// Warning about the fragments that joined a segment; the first of them is the largest.
fn fragments_kept(
    grid: &ScalarGrid,
    pieces: &Pieces,
    fragments: &[usize],
    volume: impl Fn(usize) -> f64,
) -> Option<Warning> {
    let largest = *fragments.first()?;
    let first = pieces.label.iter().position(|l| *l as usize == largest).unwrap_or(0);
    let [i, j, k] = lattice(grid, first);
    let at = grid.position(i, j, k);
    let message = format!(
        "{} fragments of {:.0} mm³ together stay with the segments that they touch most; the largest has {:.0} mm³ near \
         ({:.0}, {:.0}, {:.0}) mm",
        fragments.len(),
        fragments.iter().map(|p| volume(*p)).sum::<f64>(),
        volume(largest),
        at.x,
        at.y,
        at.z
    );
    Some(if volume(largest) < FRAGMENT_MM3 {
        Warning::info("fragments-kept", message)
    } else {
        Warning::check("fragments-kept", message).act("Check the cuts there, or use a smaller kerf.")
    })
}
