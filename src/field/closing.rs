//! Closing of a solid from far outside: what is there to be reached, and how deep places lie under the closing surface.

use super::{flood, sky};
use prosopon_geometry::ScalarGrid;
use prosopon_geometry::control::{Cancelled, Control};

/// How far the closing surface may lie below the solid's own before it counts, in spacings: more than its own error, so
/// that what faces the outside openly keeps its exact distance.
const SLACK: f32 = 0.25;
/// No node of the far outside is known yet.
const NONE: u32 = u32::MAX;

/// Marks what is far outside: farther than `closing` from the solid, seeing at least `least_sky` of the sky, and reached from
/// the border over such places.
pub(super) fn far_outside(
    solid: &ScalarGrid,
    closing: f64,
    least_sky: f64,
    control: &Control,
) -> Result<Vec<bool>, Cancelled> {
    let free = flood::from_border(solid.dims, |n| f64::from(solid.values[n]) > closing);
    control.check()?;
    if least_sky <= 0.0 {
        return Ok(free);
    }
    // Obstacles are at least two closing radii thick, so no longer steps can skip them.
    let seen = sky::seen(solid.dims, &free, 2.0 * closing / solid.spacing, control)?;
    Ok(flood::from_border(solid.dims, |n| free[n] && f64::from(seen[n]) >= least_sky))
}

/// Lowers the values of `solid` to the closing's, down to `-depth`.
///
/// A place at distance r from the far outside lies r - closing below the closing surface. As distances are 1-Lipschitz its
/// height is the largest min(d(y), closing + spacing) - |x - y| over far nodes y, d their distance from the solid. The best y
/// is handed on from node to node, layer by layer and then back and forth (vector distance transform, Danielsson 1980).
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
        for &n in order.iter().rev() {
            heights.improve(n as usize);
        }
        control.check()?;
        for &n in &order {
            heights.improve(n as usize);
        }
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
    /// Largest distance that counts for a far node, mm.
    most: f32,
    /// Best far node of each other node.
    source: Vec<u32>,
}

impl<'a> Heights<'a> {
    fn new(solid: &'a ScalarGrid, outside: &'a [bool], closing: f64) -> Self {
        let source = vec![NONE; outside.len()];
        Self { solid, outside, most: (closing + solid.spacing) as f32, source }
    }

    /// Height of node `x` by the far node `y`, mm.
    fn of(&self, x: usize, y: u32) -> f32 {
        if y == NONE {
            return f32::NEG_INFINITY;
        }
        let (from, to) = (place(self.solid.dims, x), place(self.solid.dims, y as usize));
        let steps: usize = (0..3).map(|a| from[a].abs_diff(to[a]).pow(2)).sum();
        self.solid.values[y as usize].min(self.most) - (steps as f32).sqrt() * self.solid.spacing as f32
    }

    /// Takes over the best far node among those of the neighbours; returns the height.
    fn improve(&mut self, x: usize) -> f32 {
        let mut best = self.of(x, self.source[x]);
        let mut source = self.source[x];
        flood::for_box(self.solid.dims, x, |to| {
            let candidate = if self.outside[to] { to as u32 } else { self.source[to] };
            if candidate == source {
                return;
            }
            let height = self.of(x, candidate);
            if height > best {
                (best, source) = (height, candidate);
            }
        });
        self.source[x] = source;
        best
    }

    /// Goes inwards from the far outside in layers until heights fall below `least`; returns the nodes in that order.
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

fn place([nx, ny, _]: [usize; 3], n: usize) -> [usize; 3] {
    [n % nx, n / nx % ny, n / (nx * ny)]
}
