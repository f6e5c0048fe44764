use crate::error::{FieldError, within, within_coordinates};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// Cells along the edge of a brick, and nodes along the edge of a tile.
pub(super) const EDGE: usize = 8;
/// Most samples of a field: 512³ single-precision values are half a gigabyte.
pub(super) const MOST_SAMPLES: u64 = 1 << 27;

/// Resolution of a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// Number of cells along the edge of the bounding cube, rounded up to a multiple of 8.
    Cells(u32),
    /// Edge of the finest cell, mm; the cube is enlarged to a multiple of eight cells.
    SpacingMm(f64),
}

/// Largest difference allowed between a value and its interpolation from a coarser cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// Share of the edge of the bounding cube (our reading of Wang 2009, Table 3).
    Relative(f64),
    /// Absolute tolerance, mm.
    Mm(f64),
}

/// Settings of the published methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampledSettings {
    /// Resolution of the finest grid.
    pub resolution: Resolution,
    /// Tolerance of the octrees; the dense grid ignores it.
    pub tolerance: Tolerance,
    /// Half-width of the band around the surface in which values have full accuracy (ζ of Wang 2009), mm.
    pub band_mm: f64,
    /// Distance that the bounding cube extends beyond the surface, mm.
    pub margin_mm: f64,
}

impl Default for SampledSettings {
    fn default() -> Self {
        Self { resolution: Resolution::Cells(256), tolerance: Tolerance::Relative(1e-5), band_mm: 5.0, margin_mm: 5.0 }
    }
}

/// The bounding cube and its cells; node (i, j, k) lies at `origin + spacing (i, j, k)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cube {
    pub(super) origin: Point,
    /// Edge of the finest cell, mm.
    pub(super) spacing: f64,
    /// Number of finest cells along an edge: a multiple of [`EDGE`].
    pub(super) cells: usize,
}

impl Cube {
    /// The cube around `surface` for these `settings`.
    pub(super) fn around(surface: &TriMesh, settings: &SampledSettings) -> Result<Self, FieldError> {
        within("band_mm", settings.band_mm, 0.0..=200.0, "0 to 200 mm")?;
        within("margin_mm", settings.margin_mm, 0.0..=1000.0, "0 to 1000 mm")?;
        match settings.tolerance {
            Tolerance::Relative(t) => within("tolerance", t, 1e-9..=0.1, "1e-9 to 0.1 of the cube's edge")?,
            Tolerance::Mm(t) => within("tolerance_mm", t, 1e-6..=50.0, "1e-6 to 50 mm")?,
        }
        let bounds = surface.bounds();
        let largest = within_coordinates(&bounds)?;
        let bounds = bounds.grown(settings.margin_mm);
        // A surface that is a single point still gets a cube, larger than the rounding of its coordinates.
        let edge = (bounds.max - bounds.min).max().max(1e-3).max(1e-6 * largest);
        let (spacing, cells) = match settings.resolution {
            Resolution::Cells(n) => {
                within("resolution", f64::from(n), 8.0..=2048.0, "8 to 2048 cells")?;
                let cells = (n as usize).next_multiple_of(EDGE);
                (edge / cells as f64, cells)
            }
            Resolution::SpacingMm(spacing) => {
                within("spacing_mm", spacing, 0.01..=50.0, "0.01 to 50 mm")?;
                let cells = (edge / spacing).ceil().max(1.0);
                if cells > 2048.0 {
                    let samples = (cells * cells * cells) as u64;
                    return Err(FieldError::TooLarge { spacing_mm: spacing, samples, allowed: MOST_SAMPLES });
                }
                (spacing, (cells as usize).next_multiple_of(EDGE))
            }
        };
        let origin = bounds.center() - Vector::repeat(0.5 * spacing * cells as f64);
        Ok(Self { origin, spacing, cells })
    }

    /// Length of an edge, mm.
    pub(super) fn edge(&self) -> f64 {
        self.spacing * self.cells as f64
    }

    /// Number of bricks along an edge.
    pub(super) fn bricks(&self) -> usize {
        self.cells / EDGE
    }

    /// The cube as a box, LPS mm.
    pub(super) fn domain(&self) -> Aabb {
        Aabb { min: self.origin, max: self.origin + Vector::repeat(self.edge()) }
    }

    /// The tolerance, mm.
    pub(super) fn tolerance_mm(&self, tolerance: Tolerance) -> f64 {
        match tolerance {
            Tolerance::Relative(t) => t * self.edge(),
            Tolerance::Mm(t) => t,
        }
    }

    /// Refuses a field of more than [`MOST_SAMPLES`].
    pub(super) fn allow(&self, samples: u64) -> Result<(), FieldError> {
        if samples <= MOST_SAMPLES {
            return Ok(());
        }
        Err(FieldError::TooLarge { spacing_mm: self.spacing, samples, allowed: MOST_SAMPLES })
    }
}
