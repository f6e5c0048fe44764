//! Distances of grid nodes from the cuts that separate them from other segments.

use std::collections::BTreeMap;

use super::checked_cut::CheckedCut;
use super::lattice::{Crossing, lattice, neighbours, strides};
use prosopon_geometry::{Point, ScalarGrid};

/// Distances from the separating cuts, and their kerf, at the grid nodes beside them.
pub(super) struct Separation {
    /// Distance from an inside node to the nearest cap of a cut that separates it from a neighbour in another segment, mm;
    /// infinite elsewhere, negative inside the kerf.
    pub(super) distance: Vec<f32>,
    /// Kerf of the nearest cut at these nodes, mm; empty when no cut has a kerf.
    pub(super) kerf: Vec<f32>,
    /// Where a cut runs between a node of a segment and a neighbour in air: distance of the air node from the segment's cap, mm.
    ///
    /// The key is the air node and the segment.
    pub(super) beyond: BTreeMap<(usize, u32), f32>,
    /// Indices of the cuts that bound each segment, ascending.
    pub(super) bounded_by: Vec<Vec<usize>>,
}

/// A cut with its kerf.
pub(super) struct Saw<'a> {
    pub(super) checked_cut: &'a CheckedCut,
    pub(super) kerf_mm: f64,
}

impl Separation {
    /// `segment` holds the segment of each node; nodes in air and in dropped fragments have a number of `n_segments` or more.
    pub(super) fn new(
        grid: &ScalarGrid,
        segment: &[u32],
        n_segments: u32,
        crossings: &[Crossing],
        saws: &[Saw<'_>],
    ) -> Self {
        let mut separation = Self {
            distance: vec![f32::INFINITY; segment.len()],
            kerf: if saws.iter().any(|s| s.kerf_mm > 0.0) { vec![0.0; segment.len()] } else { Vec::new() },
            beyond: BTreeMap::new(),
            bounded_by: vec![Vec::new(); n_segments as usize],
        };
        let steps = strides(grid);
        let ends = |c: &Crossing| [c.node, c.node + steps[c.axis]];
        let between: Vec<Crossing> =
            crossings.iter().copied().filter(|c| c.in_bone && segment[ends(c)[0]] != segment[ends(c)[1]]).collect();
        // A node that lies in a cut keeps a small depth, otherwise it would be outside both segments.
        let least = (1e-3 * grid.spacing) as f32;
        let mut beside = Vec::new();
        for c in &between {
            for (node, distance) in ends(c).into_iter().zip(c.distance) {
                separation.near(node, distance.max(least), saws[c.cut].kerf_mm as f32);
                if let Some(list) = separation.bounded_by.get_mut(segment[node] as usize) {
                    beside.push(node);
                    if let Err(place) = list.binary_search(&c.cut) {
                        list.insert(place, c.cut);
                    }
                }
            }
        }
        for (cut, saw) in saws.iter().enumerate().filter(|(_, s)| s.kerf_mm > 0.0) {
            separation.widen(grid, saw, between.iter().filter(|c| c.cut == cut).map(ends));
        }
        separation.round_the_rim(grid, segment, crossings, beside, saws);
        separation
    }

    fn near(&mut self, node: usize, distance: f32, kerf: f32) {
        if distance - 0.5 * kerf < self.distance[node] {
            self.distance[node] = distance - 0.5 * kerf;
            if let Some(k) = self.kerf.get_mut(node) {
                *k = kerf;
            }
        }
    }

    /// Sets the distances of the bone's nodes that the kerf of one saw reaches around the crossings `at`.
    fn widen(&mut self, grid: &ScalarGrid, saw: &Saw<'_>, at: impl Iterator<Item = [usize; 2]>) {
        let reach = (0.5 * saw.kerf_mm / grid.spacing).ceil() as usize + 2;
        let mut nodes = Vec::new();
        let mut seen = vec![false; grid.values.len()];
        for end in at.map(|[node, _]| lattice(grid, node)) {
            let range = |a: usize| end[a].saturating_sub(reach)..=(end[a] + reach).min(grid.dims[a] - 1);
            for k in range(2) {
                for j in range(1) {
                    for i in range(0) {
                        let node = grid.index(i, j, k);
                        if grid.values[node] < 0.0 && !std::mem::replace(&mut seen[node], true) {
                            nodes.push(node);
                        }
                    }
                }
            }
        }
        let positions: Vec<Point> = nodes.iter().map(|n| position(grid, *n)).collect();
        for (node, distance) in nodes.into_iter().zip(saw.checked_cut.distances(&positions)) {
            self.near(node, distance as f32, saw.kerf_mm as f32);
        }
    }

    /// Extends the caps to the rim, where a cut runs between bone and air; otherwise bone would jut out over the cut.
    fn round_the_rim(
        &mut self,
        grid: &ScalarGrid,
        segment: &[u32],
        crossings: &[Crossing],
        beside: Vec<usize>,
        saws: &[Saw<'_>],
    ) {
        let mut on_rim = vec![false; segment.len()];
        for node in beside {
            on_rim[node] = true;
            for other in neighbours(grid, node).filter(|other| segment[*other] == segment[node]) {
                on_rim[other] = true;
            }
        }
        let least = (1e-3 * grid.spacing) as f32;
        let steps = strides(grid);
        for c in crossings.iter().filter(|c| !c.in_bone) {
            let (ends, inside) = ([c.node, c.node + steps[c.axis]], usize::from(grid.values[c.node] >= 0.0));
            let (node, air) = (ends[inside], ends[1 - inside]);
            let own = segment[node];
            if !on_rim[node] || !self.bounded_by.get(own as usize).is_some_and(|b| b.contains(&c.cut)) {
                continue;
            }
            let kerf = saws[c.cut].kerf_mm as f32;
            self.near(node, c.distance[inside].max(least), kerf);
            let far = self.beyond.entry((air, own)).or_insert(0.0);
            *far = far.max(c.distance[1 - inside].max(least) + 0.5 * kerf);
        }
    }

    /// Distance from a node of another segment to the cap on this side of the cut, mm; `depth` where no cut is near.
    pub(super) fn across(&self, node: usize, depth: f32) -> f32 {
        let distance = self.distance[node];
        if distance.is_finite() { distance + self.kerf.get(node).copied().unwrap_or(0.0) } else { depth }
    }
}

fn position(grid: &ScalarGrid, node: usize) -> Point {
    let [i, j, k] = lattice(grid, node);
    grid.position(i, j, k)
}
