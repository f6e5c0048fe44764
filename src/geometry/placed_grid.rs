use super::{Motion, Point, ScalarGrid};

/// A grid that lies in space in any direction.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedGrid {
    /// The grid, in its own frame.
    pub grid: ScalarGrid,
    /// Maps a place in space into that frame.
    pub into_grid: Motion,
}

impl PlacedGrid {
    /// Trilinear interpolation at `p` in space; see [`ScalarGrid::sample`].
    #[must_use]
    pub fn sample(&self, p: &Point) -> f64 {
        self.grid.sample(&(self.into_grid * p))
    }

    /// The grid moved in space.
    #[must_use]
    pub fn moved(&self, motion: &Motion) -> Self {
        Self { grid: self.grid.clone(), into_grid: self.into_grid * motion.inverse() }
    }
}

impl From<ScalarGrid> for PlacedGrid {
    fn from(grid: ScalarGrid) -> Self {
        Self { grid, into_grid: Motion::identity() }
    }
}
