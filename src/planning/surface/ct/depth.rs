//! Depth below the skin.

use super::distance::{Nearest, to_zero};
use super::tuning::{DEPTH_TOLERANCE, MAX_DEPTH_MM};
use prosopon_geometry::ScalarGrid;

/// Depth below the skin, mm: a lower bound of the true depth, capped.
pub(super) struct Depth {
    inside: Vec<bool>,
    nearest: Nearest,
    spacing: f64,
    cap: f64,
}

impl Depth {
    pub(super) fn below(skin: &ScalarGrid) -> Self {
        let dims = skin.dims;
        // The lattice's border counts as outside, so that bone ends before the caps that close the skin there.
        let at_border = |at: usize| {
            let place = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
            (0..3).any(|a| place[a] == 0 || place[a] == dims[a] - 1)
        };
        let inside: Vec<bool> = skin.values.iter().enumerate().map(|(at, v)| *v < 0.0 && !at_border(at)).collect();
        let value = |at: usize| if inside[at] || skin.values[at] >= 0.0 { skin.values[at] } else { 1.0 };
        let cap = ((MAX_DEPTH_MM + 1.0) / skin.spacing).ceil();
        let nearest = Nearest::of(|at| to_zero(value, dims, at), dims, cap as u16);
        Self { inside, nearest, spacing: skin.spacing, cap }
    }

    pub(super) fn is_inside(&self, index: usize) -> bool {
        self.inside[index]
    }

    pub(super) fn at(&self, index: usize) -> f64 {
        if !self.inside[index] {
            return -self.spacing;
        }
        let steps = self.nearest.get(index).map_or(self.cap, |(d, offset)| f64::from(d + offset));
        self.spacing * (steps - DEPTH_TOLERANCE)
    }
}
