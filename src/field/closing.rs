//! Closing of a solid from the far outside.

use super::flood;
use super::visibility::visibility;
use prosopon_geometry::ScalarGrid;
use prosopon_geometry::control::{Cancelled, Control};

/// Depth of the closing surface below the solid's own, in spacings, up to which it is ignored.
///
/// It exceeds the closing surface's own error, so a surface that faces the outside openly keeps its exact distance.
const SLACK: f32 = 0.25;
/// Marks a node for which no far node is known.
const NONE: u32 = u32::MAX;

/// Marks the far outside.
///
/// Its nodes are farther than `closing` (mm) from the solid, see at least `min_visibility` of all directions, and connect to the
/// grid's border over such nodes.
pub(super) fn far_outside(
    solid: &ScalarGrid,
    closing: f64,
    min_visibility: f64,
    control: &Control,
) -> Result<Vec<bool>, Cancelled> {
    let free = flood::from_border(solid.dims, |n| f64::from(solid.values[n]) > closing);
    control.check()?;
    if min_visibility <= 0.0 {
        return Ok(free);
    }
    // Obstacles are at least two closing radii thick, so steps up to that length cannot skip them.
    let visible = visibility(solid.dims, &free, 2.0 * closing / solid.spacing, control)?;
    Ok(flood::from_border(solid.dims, |n| free[n] && f64::from(visible[n]) >= min_visibility))
}

/// Lowers the values of `solid` to those of its closing, down to `-depth` (mm).
///
/// A point at distance r from the far outside has the height `closing - r` over the closing surface, negative below it. As
/// distances are 1-Lipschitz, the height at x is the largest `min(d(y), closing + spacing) - |x - y|` over the far nodes y, where
/// `d(y)` is the distance of y from the solid. Each node keeps the best y of itself and its neighbours, first layer by layer from
/// the far outside, then in backward and forward sweeps (vector distance transform, Danielsson 1980).
pub(super) fn close(
    solid: &mut ScalarGrid,
    outside: &[bool],
    closing: f64,
    depth: f64,
    control: &Control,
) -> Result<(), Cancelled> {
    let mut heights = Heights::new(solid, outside, closing);
    let order = heights.descend(-depth as f32, control)?;
    for _ in 0..2 {
        control.check()?;
        order.iter().rev().for_each(|&n| heights.settle(n as usize));
        control.check()?;
        order.iter().for_each(|&n| heights.settle(n as usize));
    }
    let slack = SLACK * solid.spacing as f32;
    let lowered: Vec<f32> = (0..outside.len())
        .map(|n| {
            let own = solid.values[n];
            if outside[n] { own } else { own.min((heights.of(n, heights.source[n]) + slack).max(-depth as f32)) }
        })
        .collect();
    solid.values = lowered;
    Ok(())
}

struct Heights<'a> {
    solid: &'a ScalarGrid,
    outside: &'a [bool],
    /// Upper limit for the distance of a far node, mm.
    most: f32,
    /// Best far node of each other node, or [`NONE`].
    source: Vec<u32>,
    /// Nodes with a neighbour whose source may have changed since their last visit.
    unsettled: Vec<bool>,
}

impl<'a> Heights<'a> {
    fn new(solid: &'a ScalarGrid, outside: &'a [bool], closing: f64) -> Self {
        let (source, unsettled) = (vec![NONE; outside.len()], vec![true; outside.len()]);
        Self { solid, outside, most: (closing + solid.spacing) as f32, source, unsettled }
    }

    /// Height of node `x` that follows from the far node `y`, mm.
    fn of(&self, x: usize, y: u32) -> f32 {
        self.at(place(self.solid.dims, x as u32), y)
    }

    /// Height of the node at place `from` that follows from the far node `y`, mm.
    fn at(&self, from: [u32; 3], y: u32) -> f32 {
        if y == NONE {
            return f32::NEG_INFINITY;
        }
        let to = place(self.solid.dims, y);
        // `y` lies within the closing radius and the depth of `from`, about a thousand nodes, so the squares fit.
        let steps: u32 = (0..3).map(|a| from[a].abs_diff(to[a]).pow(2)).sum();
        self.solid.values[y as usize].min(self.most) - (steps as f32).sqrt() * self.solid.spacing as f32
    }

    /// Gives `x` the best far node among its own and its neighbours'; returns the height, mm.
    fn improve(&mut self, x: usize) -> f32 {
        let from = place(self.solid.dims, x as u32);
        let mut source = self.source[x];
        let mut best = self.at(from, source);
        let mut last = source;
        flood::for_box(self.solid.dims, x, |to| {
            let candidate = if self.outside[to] { to as u32 } else { self.source[to] };
            if candidate == source || candidate == last {
                return;
            }
            last = candidate;
            let height = self.at(from, candidate);
            if height > best {
                (best, source) = (height, candidate);
            }
        });
        self.source[x] = source;
        best
    }

    /// [`Self::improve`] for a node that can still improve: most cannot after the first sweep.
    fn settle(&mut self, x: usize) {
        if !std::mem::take(&mut self.unsettled[x]) {
            return;
        }
        let before = self.source[x];
        self.improve(x);
        if self.source[x] != before {
            flood::for_box(self.solid.dims, x, |to| self.unsettled[to] = true);
        }
    }

    /// Visits nodes in layers inwards from the far outside; returns them in that order.
    ///
    /// It stops where heights fall below `least`, mm.
    fn descend(&mut self, least: f32, control: &Control) -> Result<Vec<u32>, Cancelled> {
        let dims = self.solid.dims;
        let mut queued = self.outside.to_vec();
        let mut layer: Vec<u32> = Vec::new();
        for x in 0..self.outside.len() {
            let mut touches = false;
            if !self.outside[x] {
                flood::for_box(dims, x, |to| touches |= self.outside[to]);
            }
            if touches {
                queued[x] = true;
                layer.push(x as u32);
            }
        }
        let mut order = Vec::new();
        while !layer.is_empty() {
            control.check()?;
            let mut next = Vec::new();
            for &x in &layer {
                if self.improve(x as usize) < least {
                    continue;
                }
                flood::for_box(dims, x as usize, |to| {
                    if !queued[to] {
                        queued[to] = true;
                        next.push(to as u32);
                    }
                });
            }
            order.append(&mut layer);
            layer = next;
        }
        Ok(order)
    }
}

/// Place of node `n`; 32 bits, because divisions of 64 bits take most of the time otherwise.
fn place([nx, ny, _]: [usize; 3], n: u32) -> [u32; 3] {
    let (nx, ny) = (nx as u32, ny as u32);
    let row = n / nx;
    [n % nx, row % ny, row / ny]
}
